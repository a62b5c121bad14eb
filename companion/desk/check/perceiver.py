"""Checks the perceiver: whether it loads, and whether it is fast enough."""

from __future__ import annotations

from anytraverse.pace import Pace
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, skipped, warned
from companion.vision.warm_up import too_slow

CHECK = "perceiver"
_UNMEASURED = "; how often a foreign place matches one of many remembered ones is not measured for it"


def check_perceiver(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the perceiver loads, and is fast enough for the freshness limit T."""
    if rover.running is not None:
        told = rover.told(CHECK)
        model, step = str(told.get("model", "unknown")), told.get("step_ms")
        if not isinstance(step, float | int) or rover.running.get("latency_ms") is None:
            return [skipped(CHECK, f"{model}, not timed yet: ask again when some frames have been judged")]
        step, measured = step / 1e3, told.get("match_measured") is True
    else:
        trouble, model, step, judging, *_ = rover.perceives
        if trouble:
            return [failed(CHECK, trouble)]
        measured = judging is not None and bool(judging.thresholds.match)
    pace = Pace(step, 1.0 / rover.config.camera.rate, rover.config.freshness)
    if not pace.keeps:
        return [(failed if rover.holds else warned)(CHECK, too_slow(pace))]
    return [passed(CHECK, f"{model}, {1e3 * step:.0f} ms a frame{'' if measured else _UNMEASURED}")]
