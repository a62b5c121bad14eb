"""Checks whether the vehicle can stop before what its camera shows: as computed, and as measured.

Also how large a tile is, and its course.

Course and heading are needed to see that it drives backwards.
"""

from __future__ import annotations

from companion.config.stopping import Stopping, describe_tile, judge_stopping
from companion.config.whole_check import unchecked
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.desk.check.zone_file import read_zone_files
from companion.desk.check.zone_match import changed_since

CHECK = "stopping"
TILE = "tile"
ZONE = "zone"
COURSE = "course"
_SPARE = 0.1
"""m by which a zone may be too short: the perceiver's time for a frame is never measured twice the same."""
_REMEDY = {
    "position": "no position with a fix is heard: test outdoors, and stream GLOBAL_POSITION_INT here at 2 Hz",
    "heading": "no heading is heard: calibrate the compass, or stream ATTITUDE here",
}


def check_stopping(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the vehicle can stop before an obstacle that the camera shows."""
    worst = failed if rover.holds else warned
    if rover.leaves_link:
        refused = (rover.running or {}).get("hold_refused")
        if refused:
            return [worst(CHECK, f"the companion that runs refuses policy hold: {refused}: see its log")]
        return [passed(CHECK, "the companion that runs allows policy hold")]
    config, judged = rover.config, _judged(rover)
    name, fastest = rover.asked.speed or ("", None)
    if isinstance(judged, str):
        if rover.holds and not config.stopping.unchecked:
            return [failed(CHECK, unchecked(judged))]
        return [warned(CHECK, f"not checked: {judged}")]
    configured = config.stopping.speed
    by = ""
    if fastest is not None and (configured is None or fastest > configured):
        by = f"{name} says {fastest:g} m/s; "
    if judged.enough:
        return [passed(CHECK, by + judged.describe())]
    refusal = "hold cannot be given: " if rover.holds else ""
    return [worst(CHECK, f"{refusal}{by}{judged.describe()}")]


def _judged(rover: CheckedRover) -> Stopping | str:
    """Judge the stop with what perceiver and autopilot tell; where the companion runs, without that."""
    config = rover.config
    if rover.leaves_link:
        return judge_stopping(config)
    asked, perceives = rover.asked, rover.perceives
    _, fastest = asked.speed or ("", None)
    if perceives.judging is None:
        return judge_stopping(config, perceives.step, None, fastest, asked.overrun)
    guides = config.call.policy == "guide"
    now = HoldConditions(perceives.judging, perceives.step, asked.overrun, fastest, guides)
    return HoldGate(config).stopping(now)


def check_tile(rover: CheckedRover) -> list[CheckFinding]:
    """Tell how large a tile is, and check that a rock fills it while the vehicle can still stop.

    The check fails where the vehicle does not fit into the region of interest.
    """
    if rover.running is not None:
        return [skipped(TILE, "the companion that runs has told it in its log, at its start")]
    judging = rover.perceives.judging
    if judging is None:
        return [skipped(TILE, "not known without a perceiver that runs")]
    if judging.misfit:
        text = f"{judging.misfit}, or correct [roi] or [corridor]: till then the companion is in a fault"
        return [failed(TILE, text)]
    text, in_time = describe_tile(rover.config, judging)
    return [(passed if in_time else warned)(TILE, text)]


def check_zone(rover: CheckedRover) -> list[CheckFinding]:
    """Tell whether the newest measured detection zone covers the stop as it is judged now."""
    zones, left_out = read_zone_files(rover.folder, most=1)
    if left_out:
        return [warned(ZONE, left_out[0])]
    if not zones:
        return [skipped(ZONE, "not measured: `companion check --zone`, on blocks")]
    (zone,) = zones
    text = f"measured {zone.at[:4]}-{zone.at[4:6]}-{zone.at[6:8]}: {zone.verdict}"
    if not zone.covers:
        return [warned(ZONE, text)]
    if changed := changed_since(zone, rover):
        return [warned(ZONE, f"{text}; but with another {', another '.join(changed)}: measure again")]
    judged, needs = _judged(rover), zone.stop.get("needs")
    if needs is None or isinstance(judged, str) or judged.needs > needs + _SPARE:
        now = judged if isinstance(judged, str) else f"it takes {judged.needs:.1f} m at {judged.speed:g} m/s"
        return [warned(ZONE, f"{text}; now {now}: measure again")]
    return [passed(ZONE, text)]


def check_course(rover: CheckedRover) -> list[CheckFinding]:
    """Check that it would be noticed if the vehicle drove where its camera does not look."""
    if rover.leaves_link:
        told = rover.running or {}
        missing = str(told["course"]) if "course" in told else None
    else:
        missing = rover.asked.course if rover.asked.heard else None
    if missing is None:
        return [skipped(COURSE, "not known without an autopilot")]
    if missing:
        why = _REMEDY.get(missing, missing)
        return [warned(COURSE, f"not judged whether it drives backwards or out of the view: {why}")]
    camera, mount = rover.config.camera, rover.config.mount
    return [
        passed(
            COURSE, f"known; the camera looks {mount.heading:g} degrees off the nose, {camera.view:g} wide"
        )
    ]
