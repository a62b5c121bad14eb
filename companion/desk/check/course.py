"""Checks whether it is known where the vehicle drives: course and heading, by which reversing is seen."""

from __future__ import annotations

from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, passed, skipped, warned

CHECK = "course"
_REMEDY = {
    "position": "no position with a fix is heard: test outdoors, and stream GLOBAL_POSITION_INT here at 2 Hz",
    "heading": "no heading is heard: calibrate the compass, or stream ATTITUDE here",
}


def check_course(rover: CheckedRover) -> list[CheckFinding]:
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
