"""Simulates what PX4 does when its manual control, a stream of MANUAL_CONTROL, ends. Pure: times come in.

Only COM_RC_IN_MODE 1 is simulated, with which MANUAL_CONTROL alone counts and the transmitter is ignored.
With any other value MANUAL_CONTROL is ignored, and the transmitter counts as never lost.
"""

from __future__ import annotations

import math
from enum import IntEnum

from companion.sim.field.parameters import INT32, REAL32, Parameters, Row

MAVLINK_ONLY = 1
"""Value of COM_RC_IN_MODE."""
PARAMETERS: tuple[Row, ...] = (
    ("COM_RC_IN_MODE", INT32, 3, 0, 8),
    ("COM_RC_LOSS_T", REAL32, 0.5, 0.0, 35.0),
    ("COM_FAIL_ACT_T", REAL32, 5.0, 0.0, 25.0),
    ("COM_RCL_EXCEPT", INT32, 0, 0, 31),
    ("NAV_RCL_ACT", INT32, 1, 0, 7),
)


class Excepted(IntEnum):
    """Bits of COM_RCL_EXCEPT: kinds of modes in which the loss is ignored."""

    MISSION = 1
    AUTO = 2
    OFFBOARD = 4


class Action(IntEnum):
    """Values of NAV_RCL_ACT that are simulated. Any other one does nothing."""

    HOLD = 1
    RETURN = 2


class ManualControl:
    """Follows the stream, and says which fail-safe acts.

    A stream that was missing when the vehicle was armed is no loss before it came once. A fail-safe acts
    until another mode is set, also when the stream is back before. A mode that is set while the stream is
    still away takes over from it.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._heard_at = -math.inf
        self._missing_at_arming = True
        self._acts_since: float | None = None
        self._failing = self._taken_over = False

    @property
    def mavlink_only(self) -> bool:
        """Whether MANUAL_CONTROL counts, and the transmitter does not."""
        return self._parameters["COM_RC_IN_MODE"] == MAVLINK_ONLY

    def received(self, now: float) -> None:
        """Take a MANUAL_CONTROL."""
        self._heard_at = now

    def lost(self, now: float) -> bool:
        """Whether MANUAL_CONTROL counts, and does not come."""
        return self.mavlink_only and now - self._heard_at > self._parameters["COM_RC_LOSS_T"]

    def mode_set(self) -> None:
        """Take in that a mode was set from outside."""
        if self._acts_since is not None:
            self._taken_over = self._failing
            self._acts_since = self._acts_since if self._failing else None

    def poll(self, kind: Excepted | None, now: float, *, armed: bool) -> Action | None:
        """Return the fail-safe that acts now, None for none. kind: of the mode that was set last."""
        lost = self.lost(now)
        if not armed:
            self._missing_at_arming = lost
            self._acts_since, self._failing, self._taken_over = None, False, False
            return None
        self._missing_at_arming = self._missing_at_arming and lost
        excepted = kind is not None and int(self._parameters["COM_RCL_EXCEPT"]) & kind
        self._failing = lost and not excepted and not self._missing_at_arming
        action = int(self._parameters["NAV_RCL_ACT"])
        if action not in {int(known) for known in Action}:
            return None
        if self._failing and self._acts_since is None:
            self._acts_since = now
        elif self._taken_over and not self._failing:
            self._acts_since, self._taken_over = None, False
        if self._acts_since is None or self._taken_over:
            return None
        waits = now - self._acts_since < self._parameters["COM_FAIL_ACT_T"]
        return Action.HOLD if waits else Action(action)
