"""Delivers a policy request: sends it again with back-off until it is settled."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.delivery import FIRST_BACK_OFF_S, LIFETIME_S, LONGEST_BACK_OFF_S
from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID, SET_POLICY, Policy


class PolicyStatus(Enum):
    """Names the status of a policy request. All but the first two are final."""

    WAITING = "waiting"
    """Not sent yet: no heartbeat of the companion is received."""
    SENT = "sent"
    GRANTED = "granted"
    REFUSED = "refused"
    """A STATUSTEXT of the rover says why."""
    EXPIRED = "expired"
    """No acknowledgement within 60 s."""


@dataclass(eq=False)
class PendingPolicy:
    """Delivers one policy request to one rover. The owner sends what `due` returns, and reports replies."""

    system: int
    policy: Policy
    created: float
    status: PolicyStatus = PolicyStatus.WAITING
    _rounds: int = 0
    _next_at: float = 0.0

    @property
    def settled(self) -> bool:
        """Whether nothing more will be sent."""
        return self.status not in (PolicyStatus.WAITING, PolicyStatus.SENT)

    def due(self, now: float) -> Any | None:
        """Return the command to send now, or None. The companion acts on the first and acknowledges each."""
        if self.settled or now < self._next_at:
            return None
        again = min(self._rounds, 0xFF)
        self._next_at = now + min(FIRST_BACK_OFF_S * 2**again, LONGEST_BACK_OFF_S)
        self._rounds += 1
        self.status = PolicyStatus.SENT
        return mavlink.MAVLink_command_long_message(
            self.system, COMPONENT_ID, ANSWER_COMMAND, again, 0, SET_POLICY, self.policy, 0, 0, 0, 0
        )

    def acknowledge(self, *, granted: bool) -> bool:
        """Take in an acknowledgement; return True when it settled the request."""
        if self.status is not PolicyStatus.SENT:
            return False
        self.status = PolicyStatus.GRANTED if granted else PolicyStatus.REFUSED
        return True

    def settle(self, now: float) -> bool:
        """Apply time limits; return True when they settled it in this call."""
        if self.settled or now - self.created < LIFETIME_S:
            return False
        self.status = PolicyStatus.EXPIRED
        return True
