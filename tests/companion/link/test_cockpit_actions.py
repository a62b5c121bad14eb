"""The actions that ship for Cockpit: what its import needs, and what the rover makes of each."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from anytraverse.resources import resource
from companion.cli import main
from companion.link.inbound import ParameterRequest
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Answer
from companion.wire.ids import Motion
from companion.wire.parameters import build

FOLDER = resource("config/cockpit")
FILES = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")}
VIEW = FILES.pop("view")
COMMANDS = sorted(set(FILES) - {"word"})
COCKPIT = (255, 240)


def value(text: Any) -> Any:
    """What Cockpit puts in the place of the only variable: the system id of the vehicle."""
    return 1 if text == "{{autopilotSystemId}}" else text


def fields(action: dict[str, Any]) -> dict[str, Any]:
    """The message's fields as Cockpit sends them: a form's fields one by one, a text as JSON."""
    config = action["messageConfig"]
    if isinstance(config, str):
        return {name: value(given) for name, given in json.loads(config).items()}
    return {name: value(field["value"]) for name, field in config.items()}


def press(name: str) -> LoopbackLink:
    """A link that was sent what a press of that action's button sends."""
    stage, action = LoopbackLink(parameters=build(["bush"], {}, {})), FILES[name]
    stage.run(0.1)
    given = fields(action)
    if action["messageType"] == "PARAM_SET":
        given["param_id"] = "".join(given["param_id"]).encode()
        given["param_type"] = getattr(mavlink, given["param_type"]["type"])
        message = mavlink.MAVLink_param_set_message(**given)
    else:
        given["command"] = getattr(mavlink, given["command"])
        message = mavlink.MAVLink_command_long_message(**given)
    stage.send(message, COCKPIT)
    stage.run(0.3)
    return stage


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_all_fields_of_cockpits_form_as_its_types(name: str) -> None:
    action = FILES[name]
    assert (action["messageType"], set(action)) == ("COMMAND_LONG", {"name", "messageType", "messageConfig"})
    types = {field: given["type"] for field, given in action["messageConfig"].items()}
    assert set(types) == set(mavlink.MAVLink_command_long_message.fieldnames)
    assert types.pop("command") == "type_struct_enum"
    assert set(types.values()) == {"number"}


def test_the_commands_are_those_of_qgroundcontrols_buttons() -> None:
    text = resource("config/qgroundcontrol/anytraverse.json").read_text(encoding="utf-8")
    theirs = {action["label"]: action for action in json.loads(text)["actions"]}
    assert {FILES[name]["name"] for name in COMMANDS} == set(theirs)
    for name in COMMANDS:
        ours, action = fields(FILES[name]), theirs[FILES[name]["name"]]
        assert (ours["target_component"], ours["command"]) == (action["compId"], "MAV_CMD_USER_1")
        assert action["mavCmd"] == mavlink.MAV_CMD_USER_1
        numbers = [f"param{number}" for number in range(1, 8)]
        assert [ours[number] for number in numbers] == [action.get(number, 0) for number in numbers]


def test_go_from_cockpits_ids_answers_the_current_call() -> None:
    (request,) = press("go").reported(Answer)
    assert (request.sender, request.target, request.motion) == (COCKPIT, 0, Motion.GO)


def test_the_word_is_a_parameter_whose_name_has_sixteen_letters() -> None:
    letters = fields(FILES["word"])["param_id"]
    assert [len(letter) for letter in letters] == [1] * 16
    (change,) = press("word").reported(ParameterRequest)
    assert (change.sender, change.name, change.value) == (COCKPIT, "AT_W_BUSH", -1.0)


def test_each_button_of_the_view_runs_a_shipped_action() -> None:
    (panel,) = VIEW["widgets"]
    buttons = [button for row in panel["options"]["elementContainers"] for button in row["elements"]]
    shipped = [FILES[name]["name"] for name in ("go", "stay", "look-again", "other-place")]
    assert [button["options"]["cockpitAction"]["name"] for button in buttons] == shipped
    for button in buttons:
        action = button["options"]["cockpitAction"]
        assert action["id"] == f"mavlink-message-action ({action['name']})"
        assert re.sub("^trail: ", "", action["name"].lower()) == button["options"]["layout"]["label"].lower()


def test_the_view_has_what_cockpits_import_asks_for() -> None:
    assert {"hash", "name", "showBottomBarOnBoot", "visible", "widgets", "miniWidgetContainers"} == set(VIEW)
    for widget in VIEW["widgets"]:
        assert {"hash", "component", "position", "size", "name", "options"} == set(widget)
    assert all({"name", "widgets"} == set(container) for container in VIEW["miniWidgetContainers"])


def test_init_copies_all_of_them_out(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path)]) == 0
    copied = {path.name: path.read_bytes() for path in (tmp_path / "cockpit").iterdir()}
    assert copied == {path.name: path.read_bytes() for path in FOLDER.iterdir()}
