"""Keeps the targets of GUIDED, a speed and a rate of turning, as ArduPilot Rover obeys them.

Other targets (positions, headings, accelerations) are not simulated and change nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import development as mavlink

if TYPE_CHECKING:
    from companion.sim.field.rover import Rover


SPEED_AND_TURN = 1479
"""type_mask of a target whose velocity and yaw rate count, and nothing else."""
LASTS = 3.0
"""s after which a target that is not sent again counts no more."""
_FRAMES = (int(mavlink.MAV_FRAME_LOCAL_NED), int(mavlink.MAV_FRAME_BODY_NED))


class GuidedTargets:
    """Gives the rover the newest target while it is in GUIDED, and takes it away where none follows."""

    def __init__(self, rover: Rover) -> None:
        self._rover = rover
        self._heard_at = -math.inf

    def forget(self) -> None:
        """Forgets the target, as ArduPilot does where it enters GUIDED."""
        self._rover.target = None

    def hear(self, frame: Any) -> None:
        """Takes a SET_POSITION_TARGET_LOCAL_NED; one that is not simulated is ignored.

        In both frames vx says forwards or backwards, as ArduPilot has it where a yaw rate comes with it.
        """
        vx, vy, rate = float(frame.vx), float(frame.vy), float(frame.yaw_rate)
        if frame.type_mask != SPEED_AND_TURN or frame.coordinate_frame not in _FRAMES:
            return
        if not all(map(math.isfinite, (vx, vy, rate))):
            return
        self._rover.target = math.copysign(math.hypot(vx, vy), vx), -rate
        self._heard_at = self._rover.time

    def lapse(self) -> bool:
        """Forgets a target that has had its time. Returns whether it did so now."""
        lapsed = self._rover.target is not None and self._rover.time - self._heard_at > LASTS
        if lapsed:
            self.forget()
        return lapsed
