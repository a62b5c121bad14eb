"""A policy asked for: sent again with back-off until the rover says that it is so, or that it will not be."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID, SET_POLICY, Policy
from gcs_plugin.pending import FIRST_BACK_OFF_S, LIFETIME_S, LONGEST_BACK_OFF_S


class Wished(Enum):
    """What became of it. All but the first two are final."""

    WAITING = "waiting"
    """Not sent yet: the companion is not heard."""
    SENT = "sent"
    GRANTED = "granted"
    REFUSED = "refused"
    """A text of the rover's says why."""
    EXPIRED = "expired"
    """No word within 60 s."""


@dataclass(eq=False)
class PolicyWish:
    """One policy for one rover; the owner asks `due` for what to send now and tells it what was heard."""

    system: int
    policy: Policy
    created: float
    status: Wished = Wished.WAITING
    _rounds: int = 0
    _next_at: float = 0.0

    @property
    def settled(self) -> bool:
        """Nothing more will be sent."""
        return self.status not in (Wished.WAITING, Wished.SENT)

    def due(self, now: float) -> Any | None:
        """The command to send now, if any. The companion acts on the first, and acknowledges each."""
        if self.settled or now < self._next_at:
            return None
        again = min(self._rounds, 0xFF)
        self._next_at = now + min(FIRST_BACK_OFF_S * 2**again, LONGEST_BACK_OFF_S)
        self._rounds += 1
        self.status = Wished.SENT
        return mavlink.MAVLink_command_long_message(
            self.system, COMPONENT_ID, ANSWER_COMMAND, again, 0, SET_POLICY, self.policy, 0, 0, 0, 0
        )

    def acknowledge(self, *, granted: bool) -> bool:
        """The rover has spoken; True when that settled it."""
        if self.status is not Wished.SENT:
            return False
        self.status = Wished.GRANTED if granted else Wished.REFUSED
        return True

    def settle(self, now: float) -> bool:
        """True when time alone has settled it just now."""
        if self.settled or now - self.created < LIFETIME_S:
            return False
        self.status = Wished.EXPIRED
        return True
