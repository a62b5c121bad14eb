"""Checks the camera (whether pictures come, how many, how old, how exposed), and the perceiver's pace."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from anytraverse.pace import Pace
from companion.cameras.shown import shown
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.vision.exposure import ADVICE
from companion.vision.infrared import REMEDY, SHARE, TEXT
from companion.vision.warm_up import too_slow

CAMERA, FRAMES, EXPOSURE, INFRARED = "camera", "frames", "exposure", "infrared"
_SLOW = 0.8
"""Share of [camera] rate below which a camera is too slow for it."""
_DARK, _FLAT = 25.0, 4.0
"""Mean of a picture's brightness, of 255, and its standard deviation, below which something is wrong."""
_WHITE_SHARE = 0.4
PERCEIVER = "perceiver"
_UNMEASURED = "; how often a foreign place matches one of many remembered ones is not measured for it"


def check_camera(rover: CheckedRover) -> list[CheckFinding]:
    """Check that a first picture comes, and has the shape that [mount] aspect says."""
    if rover.running is not None:
        return [_camera_of_running(rover.told("camera"))]
    seen, config = rover.seen, rover.config
    if seen.trouble:
        return [failed(CAMERA, seen.trouble)]
    what = f"{shown(config.camera.source)}, {seen.width} x {seen.height}"
    what += ", rectified" if config.calibration else ""
    aspect, is_now = config.mount.aspect, seen.width / seen.height
    if config.mount.height is not None and not config.mount.has_shape(seen.width, seen.height):
        wrong = (
            f"{what}, and [mount] aspect is {aspect:g}: set it to {is_now:.3f}, or the row stopping is wrong"
        )
        return [warned(CAMERA, wrong)]
    return [passed(CAMERA, what)]


def _camera_of_running(camera: Mapping[str, Any]) -> CheckFinding:
    state, reason = str(camera.get("state", "unknown")), str(camera.get("reason") or "")
    what = f"{state}, with the companion that runs"
    if state == "delivering":
        return passed(CAMERA, what)
    if state in ("failed", "ended"):
        return failed(CAMERA, f"{what}: {reason}" if reason else what)
    return warned(CAMERA, f"{what}: wait, then type this again")


def check_frames(rover: CheckedRover) -> list[CheckFinding]:
    """Check how many pictures a second come, and how old they are."""
    if rover.running is not None:
        rate, latency = rover.told("camera").get("rate"), rover.running.get("latency_ms")
        if not isinstance(rate, float) or not isinstance(latency, float | int):
            return [skipped(FRAMES, "not known yet: ask again when some frames have been judged")]
        return [_frames(rover, rate, latency / 1e3, "old when judged")]
    seen = rover.seen
    if seen.trouble:
        return [skipped(FRAMES, "not measured: no picture came")]
    if seen.rate is None:
        return [skipped(FRAMES, "not measured: one picture came, and no second one")]
    finding = _frames(rover, seen.rate, seen.age, "old when they come")
    if seen.bad:
        return [finding, warned(FRAMES, f"{seen.bad} pictures were damaged: check cable and supply")]
    return [finding]


def _frames(rover: CheckedRover, rate: float, age: float, when: str) -> CheckFinding:
    wanted, fresh = rover.config.camera.rate, rover.config.freshness
    what = f"{rate:.1f} frames/s, {1e3 * age:.0f} ms {when}"
    worst = failed if rover.holds else warned
    if rate <= 0.0 or 1.0 / rate > fresh:
        return worst(FRAMES, f"{what}: T is {fresh:g} s, so that each is too old before the next one comes")
    if age > fresh:
        return worst(FRAMES, f"{what}: that is more than T, {fresh:g} s: find what delays them")
    if rate < _SLOW * wanted:
        faster = "give the camera more light or fewer pixels"
        return warned(FRAMES, f"{what}: [camera] rate is {wanted:g}: {faster}, or set rate = {rate:.1f}")
    if age > fresh / 2.0:
        return warned(FRAMES, f"{what}: that is over half of T, {fresh:g} s: find what delays them")
    return passed(FRAMES, what)


def check_exposure(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the ground can be seen, as the companion does while it runs, with some light to spare."""
    if rover.running is not None:
        where = "type `picture` at the ground, or look into the folder pictures"
        return [skipped(EXPOSURE, f"not measured: the companion that runs has the camera: {where}")]
    seen = rover.seen
    if seen.trouble:
        return [skipped(EXPOSURE, "not measured: no picture came")]
    what = f"brightness {seen.brightness:.0f} of 255, {100 * seen.white:.0f} % white"
    if seen.exposure:
        return [failed(EXPOSURE, f"{what}, {seen.exposure}: {ADVICE[seen.exposure]}")]
    if seen.contrast < _FLAT:
        return [warned(EXPOSURE, f"{what}, all of one colour: is the lens covered?")]
    if seen.brightness < _DARK:
        return [warned(EXPOSURE, f"{what}: dark: more light, or a longer exposure")]
    if seen.white > _WHITE_SHARE:
        return [warned(EXPOSURE, f"{what}: a shorter exposure, or turn the camera away from the sun")]
    return [passed(EXPOSURE, what)]


def check_infrared(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the camera has an infrared filter, or that the perceiver handles one without."""
    if rover.running is not None:
        shown = rover.told("camera").get("infrared")
        if shown is None:
            return [skipped(INFRARED, "not known yet: ask again when it has judged frames for two minutes")]
        trained = rover.told("perceiver").get("infrared") is True
    elif rover.seen.trouble:
        return [skipped(INFRARED, "not measured: no picture came")]
    elif rover.seen.magenta is None:
        return [skipped(INFRARED, "not measured: the picture is too dark or too bright")]
    else:
        shown = rover.seen.magenta >= SHARE
        trained = shown and rover.perceives.infrared
    if not shown:
        return [passed(INFRARED, "the camera shows none")]
    if rover.config.camera.handles_infrared(trained=trained):
        return [passed(INFRARED, f"{TEXT}: {'the perceiver is trained for it' if trained else 'accepted'}")]
    return [(failed if rover.holds else warned)(INFRARED, REMEDY)]


def check_perceiver(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the perceiver loads, and is fast enough for the freshness limit T."""
    if rover.running is not None:
        told = rover.told(PERCEIVER)
        model, step = str(told.get("model", "unknown")), told.get("step_ms")
        if not isinstance(step, float | int) or rover.running.get("latency_ms") is None:
            return [
                skipped(PERCEIVER, f"{model}, not timed yet: ask again when some frames have been judged")
            ]
        step, measured = step / 1e3, told.get("match_measured") is True
    else:
        trouble, model, step, judging, *_ = rover.perceives
        if trouble:
            return [failed(PERCEIVER, trouble)]
        measured = judging is not None and bool(judging.thresholds.match)
    pace = Pace(step, 1.0 / rover.config.camera.rate, rover.config.freshness)
    if not pace.keeps:
        return [(failed if rover.holds else warned)(PERCEIVER, too_slow(pace))]
    return [passed(PERCEIVER, f"{model}, {1e3 * step:.0f} ms a frame{'' if measured else _UNMEASURED}")]
