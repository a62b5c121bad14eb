"""The Fly View actions that ship for QGroundControl: that it reads them, and what the rover makes of each."""

from __future__ import annotations

import json
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import OtherPlace
from anytraverse.resources import resource
from companion.cli import main
from companion.link.inbound import PolicyRequest
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Answer
from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID, Motion, Policy

FILE = json.loads(resource("config/qgroundcontrol/anytraverse.json").read_text(encoding="utf-8"))
ACTIONS = {action["label"]: action for action in FILE["actions"]}
QGROUNDCONTROL = (255, 190)
PARAMETERS = [f"param{number}" for number in range(1, 8)]


def press(label: str) -> LoopbackLink:
    """A link that was sent what QGroundControl sends for that button: a parameter not named is 0."""
    stage, action = LoopbackLink(), ACTIONS[label]
    stage.run(0.1)
    values = [float(action.get(name, 0.0)) for name in PARAMETERS]
    stage.send(
        mavlink.MAVLink_command_long_message(1, action["compId"], action["mavCmd"], 0, *values),
        QGROUNDCONTROL,
    )
    stage.run(0.3)
    return stage


def test_the_file_is_of_the_type_and_version_that_are_read() -> None:
    assert {key: FILE[key] for key in ("version", "fileType")} == {"version": 1, "fileType": "MavlinkActions"}


@pytest.mark.parametrize("action", FILE["actions"], ids=lambda action: action["label"])
def test_an_action_has_the_keys_that_are_needed_and_none_that_is_not_read(action: dict[str, Any]) -> None:
    needed = {"label": str, "description": str, "mavCmd": int}
    assert {key: type(action[key]) for key in needed} == needed
    rest = {key: value for key, value in action.items() if key not in needed}
    assert set(rest) <= {"compId", *PARAMETERS}
    assert all(type(value) in (int, float) for value in rest.values())
    assert (action["compId"], action["mavCmd"]) == (COMPONENT_ID, ANSWER_COMMAND)


@pytest.mark.parametrize(
    ("label", "motion"),
    [("Trail: go", Motion.GO), ("Trail: stay", Motion.STAY), ("Trail: look again", Motion.LOOK_AGAIN)],
)
def test_a_trail_button_answers_the_current_call(label: str, motion: Motion) -> None:
    (request,) = press(label).reported(Answer)
    assert (request.sender, request.target, request.motion) == (QGROUNDCONTROL, 0, motion)


def test_the_button_for_another_place_refuses_the_newest_match() -> None:
    (request,) = press("Trail: other place").reported(Answer)
    assert (request.sender, request.operations) == (QGROUNDCONTROL, (OtherPlace(0),))


@pytest.mark.parametrize(
    ("label", "policy"),
    [
        ("Companion: off", Policy.OFF),
        ("Companion: report", Policy.REPORT),
        ("Companion: hold", Policy.HOLD),
    ],
)
def test_a_companion_button_sets_the_policy(label: str, policy: Policy) -> None:
    (request,) = press(label).reported(PolicyRequest)
    assert (request.sender, request.policy) == (QGROUNDCONTROL, policy)


def test_no_button_is_left_untried() -> None:
    assert {label.split(":")[0] for label in ACTIONS} == {"Trail", "Companion"}
    assert len(ACTIONS) == len(FILE["actions"]) == 7


def test_init_copies_it_out(tmp_path: Any) -> None:
    assert main(["init", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "qgroundcontrol" / "anytraverse.json").read_text()) == FILE
