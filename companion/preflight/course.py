"""Checks whether it is known where the vehicle drives: course and heading, by which reversing is seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from companion.link.vehicle import VehicleTracker
from companion.preflight.rules import Finding, passed, skipped, warned
from companion.vehicle.course import unknown

if TYPE_CHECKING:
    from companion.preflight.rover import Rover

CHECK = "course"
_REMEDY = {
    "position": "no position with a fix is heard: test outdoors, and stream GLOBAL_POSITION_INT here at 2 Hz",
    "heading": "no heading is heard: calibrate the compass, or stream ATTITUDE here",
}


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


def check_course(rover: Rover) -> list[Finding]:
    """Check that it would be noticed if the vehicle drove where its camera does not look."""
    if rover.leaves_link:
        told = rover.running or {}
        missing = str(told["course"]) if "course" in told else None
    else:
        missing = rover.asked.course if rover.asked.heard else None
    if missing is None:
        return [skipped(CHECK, "not known without an autopilot")]
    if missing:
        why = _REMEDY.get(missing, missing)
        return [warned(CHECK, f"not judged whether it drives backwards or out of the view: {why}")]
    camera, mount = rover.config.camera, rover.config.mount
    return [
        passed(CHECK, f"known; the camera looks {mount.heading:g} degrees off the nose, {camera.view:g} wide")
    ]
