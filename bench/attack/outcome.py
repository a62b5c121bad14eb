"""Says what an attack led to, and watches a rover meanwhile."""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.faults.standing import Standing

MOST_GAP, MOST_BLIND = 1.5, 3.0
"""s between two heartbeats, and without a judged frame, that an attack may lead to."""


@dataclass
class AttackOutcome:
    """Holds the results of one kind of attack.

    gap: longest s between two heartbeats. blind: longest s in which no frame was judged, as status.json says
    once a second. reached: what the attacker got at, or did in another's name. secrets: what it read that is
    secret. figures: others, for a person.
    """

    gap: float = 0.0
    blind: float = 0.0
    reached: list[str] = field(default_factory=list)
    secrets: list[str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Whether all promises were kept."""
        return not (self.reached or self.secrets or self.gap > MOST_GAP or self.blind > MOST_BLIND)


def watched(
    rover: Standing, outcome: AttackOutcome, running: Callable[[], bool], limit: float, *, sees: bool = True
) -> None:
    """Let the rover go on while `running`, `limit` s at most, and note the longest gaps.

    sees: whether frames must be judged meanwhile.
    """
    began = beat_at = frame_at = time.monotonic()
    frames = rover.judged()
    while running() and time.monotonic() - began < limit:
        rover.step()
        now = time.monotonic()
        if rover.wire.messages.pop("HEARTBEAT", None) is not None:
            beat_at = now
        if (judged := rover.judged()) != frames:
            frames, frame_at = judged, now
        outcome.gap = max(outcome.gap, round(now - beat_at, 2))
        if sees:
            outcome.blind = max(outcome.blind, round(now - frame_at, 2))
    if rover.daemon is None or not rover.daemon.running:
        outcome.gap = outcome.blind = math.inf


def peak_memory(pid: int) -> int:
    """Return the most MB that a process has had in memory; 0 for one that has ended."""
    with contextlib.suppress(OSError):
        if found := re.search(r"^VmHWM:\s+(\d+) kB$", Path(f"/proc/{pid}/status").read_text(), re.M):
            return int(found[1]) >> 10
    return 0
