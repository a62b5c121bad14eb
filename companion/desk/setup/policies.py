"""Says of each policy what it does, and what `companion check` finds for it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

from companion.config import Config, state_folder
from companion.config.guiding import guide_lacks
from companion.desk.check.autopilot import LINK, AutopilotReadings
from companion.desk.check.here import status
from companion.desk.check.rover import CheckedRover, Perceives
from companion.desk.check.rules import Verdict, failed, passed, skipped
from companion.desk.check.table import CHECKS, survived
from companion.desk.check.watching import CameraDelivery
from companion.desk.setup.parameters import AskedAutopilot

POLICIES = {
    "report": "It calls and reports. It never touches the vehicle.",
    "shadow": "It reports, and counts what it would have held. It never touches the vehicle.",
    "hold": "It stops the vehicle where it must ask, and lets it drive on after your go.",
    "guide": "It holds, and drives an ArduPilot rover round what leaves room.",
}
_OF_THE_ROVER = frozenset(
    {"camera", "frames", "exposure", "infrared", "perceiver", "link", "autopilot", "forwarding"}
    | {"signing", "course", "stopping", "tile"}
)
"""The checks that differ from policy to policy, or from rover to rover. The computer's own come later."""


def document(
    file: str, config: Config, seen: CameraDelivery, perceives: Perceives, found: AskedAutopilot | None
) -> list[dict[str, Any]]:
    """Return one entry a policy: JSON values."""
    return [
        {
            "policy": policy,
            "what": what,
            "chosen": policy == config.call.policy,
            **_judged(
                file, replace(config, call=replace(config.call, policy=policy)), seen, perceives, found
            ),
        }
        for policy, what in POLICIES.items()
    ]


def _judged(
    file: str, config: Config, seen: CameraDelivery, perceives: Perceives, read: AskedAutopilot | None
) -> dict[str, Any]:
    rover = CheckedRover(config, file, state_folder(config))
    rover.seen, rover.perceives, rover.asked = seen, perceives, asked_for(config, read)
    found = [one for check in CHECKS if check.name in _OF_THE_ROVER for one in survived(check, rover)]
    if config.call.policy == "guide":
        lacks = guide_lacks(config)
        found.append(failed("guide", f"set {lacks}") if lacks else passed("guide", "all is set"))
    found.sort(key=lambda one: -one.verdict)
    counts = Counter(one.verdict for one in found)
    return {
        "rows": [one.row() for one in found],
        "fails": counts[Verdict.FAIL],
        "warns": counts[Verdict.WARN],
        "skips": counts[Verdict.SKIP],
    }


def asked_for(config: Config, found: AskedAutopilot | None) -> AutopilotReadings:
    """Return what an autopilot told, judged for this policy."""
    if found is None:
        return AutopilotReadings(
            [skipped(LINK, "not asked: read the autopilot's settings first")], heard=False
        )
    return found.readings(config)


def running(config: Config) -> str:
    """Say that a companion runs, which has the camera and the link; "" where none does."""
    if status(state_folder(config)) is None:
        return ""
    return (
        "The companion runs, and has camera and link. To set those up, stop it first: sudo systemctl stop "
        "companion, or Ctrl-C where it was typed"
    )
