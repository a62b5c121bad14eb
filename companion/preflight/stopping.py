"""Checks whether the vehicle can stop before an obstacle that the camera shows."""

from __future__ import annotations

from companion.policy.hold_gate import unchecked
from companion.policy.stopping import judge_stopping
from companion.preflight.rover import Rover
from companion.preflight.rules import Finding, failed, passed, warned

CHECK = "stopping"


def check_stopping(rover: Rover) -> list[Finding]:
    """Check that the vehicle can stop before an obstacle that the camera shows."""
    worst = failed if rover.holds else warned
    if rover.leaves_link:
        refused = (rover.running or {}).get("hold_refused")
        if refused:
            return [worst(CHECK, f"the companion that runs refuses policy hold: {refused}: see its log")]
        return [passed(CHECK, "the companion that runs allows policy hold")]
    config, asked = rover.config, rover.asked
    name, fastest = asked.speed if asked.speed is not None else ("", None)
    judged = judge_stopping(config, rover.perceives.step, rover.perceives.tile, fastest, asked.overrun)
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
    refusal = "policy hold is refused: " if rover.holds else ""
    return [worst(CHECK, f"{refusal}{by}{judged.describe()}")]
