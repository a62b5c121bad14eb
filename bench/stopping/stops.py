"""Describes how a rover stopped, from two looks at the field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from bench.stopping.limits import Limit
from companion.sim.field.autopilot import HAND
from companion.sim.field.rover import STANDSTILL


@dataclass(frozen=True)
class Stop:
    """A stop, from the fault to standstill, in the simulation's time and distance.

    by: who changed the mode, "" for nobody. stands: in a HOLD that was not set by hand, late or not, half a
    second later and when the companion was well again. seconds: s. metres: m. speed: m/s at the fault. gap:
    s, the longest between two heartbeats of the companion meanwhile. changed_at: when the mode changed,
    monotonic seconds; inf: it did not. hold: s from the last verified OK to the order to hold, as
    docs/faults.md defines them; None: no order. returned: s from the end of the fault, of one that ends by
    itself from its beginning, until the companion was well again; None: not awaited, or not within 15 s.
    """

    stands: bool
    seconds: float
    metres: float
    limit: Limit
    speed: float
    zone: str
    by: str
    gap: float = 0.0
    changed_at: float = math.inf
    hold: float | None = None
    returned: float | None = None

    @property
    def stopped(self) -> bool:
        """Whether it stopped within the limit, in seconds and in metres."""
        return self.stands and self.seconds <= self.limit.seconds and self.metres <= self.limit.metres


def stopped(
    before: dict[str, Any], after: dict[str, Any], limit: Limit, later: dict[str, Any] | None = None
) -> Stop:
    """Computes the stop between two statuses of the field. later: a third, to see if it still stands."""
    held = [change for change in after["mode_log"] if change["t"] >= before["t"] and change["by"] != HAND]
    return Stop(
        stands=bool(held)
        and all(abs(one["speed"]) <= STANDSTILL and one["mode"] == "HOLD" for one in (after, later or after)),
        seconds=after["t"] - before["t"],
        metres=after["distance"] - before["distance"],
        limit=limit,
        speed=before["speed"],
        zone=before["zone"],
        by=held[0]["by"] if held else "",
        changed_at=after["monotonic"] - after["t"] + held[0]["t"] if held else math.inf,
    )
