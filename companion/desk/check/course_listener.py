"""Finds out from an autopilot's messages whether it is known where the vehicle drives."""

from __future__ import annotations

from typing import Any

from companion.link.vehicle import VehicleTracker
from companion.vehicle.course import unknown


class CourseListener:
    """Takes an autopilot's messages. missing: what was never known so far, as of `unknown`."""

    def __init__(self, system_id: int) -> None:
        self._tracker = VehicleTracker(system_id)
        self.missing = unknown(None, 0.0)

    def hear(self, message: Any, now: float) -> None:
        """Take a message of the autopilot."""
        tracker, system = self._tracker, message.get_srcSystem()
        match message.get_type():
            case "HEARTBEAT":
                tracker.heartbeat(system, message, now)
            case "GLOBAL_POSITION_INT":
                tracker.position(system, message, now)
            case "ATTITUDE":
                tracker.attitude(system, message, now)
        if self.missing:
            self.missing = unknown(tracker.vehicle, now)
