"""The MAVProxy module, inside a stand-in for MAVProxy that has only what its modules are promised."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from anytraverse.operations import ForgetWord, SetWord
from companion.wire import ids
from companion.wire.call_report import CallReport
from gcs_plugin.terminal.commands import parse


class Module:
    """MAVProxy's base class of modules, as far as it promises anything."""

    def __init__(self, mpstate: Any, name: str, _description: str, *, multi_vehicle: bool = False) -> None:
        self.mpstate, self.name, self.multi_vehicle = mpstate, name, multi_vehicle
        self.target = 1, 1

    def message_is_from_primary_vehicle(self, message: Any) -> bool:
        return (message.get_srcSystem(), message.get_srcComponent()) == self.target

    def add_command(self, name: str, callback: Any, _description: str, completions: list[str]) -> None:
        self.mpstate.command_map[name] = callback
        self.mpstate.completions[name] = completions

    def remove_command(self, name: str) -> None:
        del self.mpstate.command_map[name], self.mpstate.completions[name]

    def add_completion_function(self, name: str, callback: Any) -> None:
        self.mpstate.completion_functions[name] = callback

    def unload(self) -> None:
        self.mpstate.unloaded = True


class Console:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def writeln(self, line: str) -> None:
        self.lines.append(line)


class Wire:
    """The sending end of one link."""

    srcSystem, srcComponent = 255, 230  # noqa: N815  # MAVLink's names

    def __init__(self, ground: Any, rover: Any) -> None:
        self.ground, self.rover = ground, rover
        self.replies: list[bytes] = []

    def send(self, message: Any) -> None:
        self.replies += self.rover.hear(self.ground.frame(message))


class MpState:
    """MAVProxy with a link to each rover."""

    def __init__(self, ground: Any, rovers: list[Any]) -> None:
        self.console = Console()
        self.command_map: dict[str, Any] = {}
        self.completions: dict[str, list[str]] = {}
        self.completion_functions: dict[str, Callable[[str], list[str]]] = {}
        self.unloaded = False
        self.wires = {(rover.system, ids.COMPONENT_ID): Wire(ground, rover) for rover in rovers}

    def foreach_mav(self, system: int, component: int, closure: Callable[[Any], None]) -> None:
        if (system, component) in self.wires:
            closure(self.wires[system, component])


class Proxy:
    """The module at work, with a clock of its own."""

    def __init__(self, plugin: ModuleType, monkeypatch: pytest.MonkeyPatch, ground: Any, rovers: list[Any]):
        self.rovers, self.ground, self.now = rovers, ground, 100.0
        monkeypatch.setattr(plugin, "time", self)
        self.state = MpState(ground, rovers)
        self.module = plugin.init(self.state)

    def monotonic(self) -> float:
        return self.now

    @property
    def lines(self) -> list[str]:
        return self.state.console.lines

    def run(self, seconds: float, *, silent: bool = False) -> None:
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            frames = [] if silent else [frame for rover in self.rovers for frame in rover.speak()]
            for wire in self.state.wires.values():
                frames, wire.replies = frames + wire.replies, []
            for message in self.ground.parse(b"".join(frames)):
                self.module.mavlink_packet(message)
            self.module.idle_task()

    def type(self, line: str) -> None:
        name, *arguments = line.split()
        self.state.command_map[name](arguments)


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    mp_module = ModuleType("MAVProxy.modules.lib.mp_module")
    mp_module.MPModule = Module  # type: ignore[attr-defined]
    for name in ("MAVProxy", "MAVProxy.modules", "MAVProxy.modules.lib"):
        package = ModuleType(name)
        package.mp_module = mp_module  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, name, package)
    monkeypatch.setitem(sys.modules, mp_module.__name__, mp_module)
    yield importlib.import_module("gcs_plugin.mavproxy_anytraverse")
    sys.modules.pop("gcs_plugin.mavproxy_anytraverse")


@pytest.fixture
def proxy(
    plugin: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    tiny_rover: Callable[..., Any],
    speaker: Callable[..., Any],
) -> Callable[..., Proxy]:
    def made(*calls: CallReport | None) -> Proxy:
        rovers = [tiny_rover(system, call) for system, call in enumerate(calls, 1)]
        at = Proxy(plugin, monkeypatch, speaker(255, 230), rovers)
        at.run(3.0)
        return at

    return made


Make = Callable[..., Proxy]


def test_a_call_is_printed_with_what_to_type_here(proxy: Make, thing_call: CallReport) -> None:
    at = proxy(thing_call)
    text = "\n".join(at.lines)
    assert "C7 unknown thing ahead, 38% unexplained" in text
    assert "at tap THING -1 go  |  at THING: -1, go  |  at go" in text


@pytest.mark.parametrize("line", ["at go", "at answer go", "anytraverse answer 7 go", "at 7 go", "at ok"])
def test_an_answer_reaches_the_call_in_each_of_its_spellings(
    proxy: Make, thing_call: CallReport, line: str
) -> None:
    at = proxy(thing_call)
    at.type(line)
    at.run(1.0)
    assert at.rovers[0].applied == [(7, ids.Motion.GO, ())]
    assert any("answer to 7: done" in line for line in at.lines)


@pytest.mark.parametrize(
    ("line", "word", "weight"),
    [
        ("at set bush -1", "bush", -1.0),
        ("at set dirt path: 0.5", "dirt path", 0.5),
        ("at a b: 1", "a b", 1.0),
    ],
)
def test_a_word_is_set_without_a_call(proxy: Make, line: str, word: str, weight: float) -> None:
    at = proxy(None)
    at.type(line)
    at.run(1.0)
    assert at.rovers[0].applied == [(0, ids.Motion.NONE, (SetWord(word, weight),))]


def test_a_comma_separates_changes_since_mavproxy_splits_lines_at_semicolons(proxy: Make) -> None:
    at = proxy(None)
    at.type("at bush: -1, dirt path: 0.5, forget rock, stones")
    at.run(1.0)
    operations = (SetWord("bush", -1.0), SetWord("dirt path", 0.5), ForgetWord("rock, stones"))
    assert at.rovers[0].applied == [(0, ids.Motion.NONE, operations)]


def test_several_rovers_on_several_links_each_get_their_own(proxy: Make, thing_call: CallReport) -> None:
    at = proxy(thing_call, thing_call)
    at.type("at go")
    assert "rovers 1, 2 are heard" in at.lines[-1]
    at.type("at rover 2 go")
    at.run(1.0)
    assert [len(rover.applied) for rover in at.rovers] == [0, 1]
    assert at.module.multi_vehicle, "MAVProxy hands other modules one vehicle's messages only"


def test_nothing_is_sent_to_a_companion_that_fell_silent(proxy: Make, thing_call: CallReport) -> None:
    at = proxy(thing_call)
    at.run(4.0, silent=True)
    at.type("at go")
    at.run(5.0, silent=True)
    assert at.rovers[0].applied == []
    assert any("waits: the companion is not heard" in line for line in at.lines)


def test_what_the_autopilot_says_is_printed_only_where_mavproxy_hides_it(proxy: Make) -> None:
    at = proxy(None)
    for number, at.module.target in enumerate([(1, 1), (1, 191)]):
        text = f"HOLD: companion silent, {number}".encode()
        frame = at.rovers[0].autopilot.frame(mavlink.MAVLink_statustext_message(2, text))
        for message in at.ground.parse(frame):
            at.module.mavlink_packet(message)
        at.run(0.1)
    printed = [line for line in at.lines if "HOLD: companion silent" in line]
    assert len(printed) == 1
    assert printed[0].endswith('autopilot says "HOLD: companion silent, 1"')


def test_an_answer_that_a_signing_rover_would_not_believe_says_what_to_type(proxy: Make) -> None:
    at = proxy(None)
    at.rovers[0].companion.sign()
    at.run(1.0)
    at.type("at bush: -1")
    at.run(3.0)
    assert sum("signing key PASSPHRASE" in line for line in at.lines) == 1


def test_every_line_of_its_own_help_and_of_the_page_is_understood(plugin: ModuleType) -> None:
    page = (Path(__file__).parents[2] / "docs" / "operator.md").read_text()
    table = page.split("## In MAVProxy")[1].split("\n## ")[0]
    lines = re.findall("`at ([^`]+)`", table + "\n".join(plugin.HELP))
    assert len(lines) > 15
    for line in lines:
        assert line == "help" or parse(plugin.typed_line(line.split())), line


def test_help_and_mistakes_are_told(proxy: Make) -> None:
    at = proxy(None)
    at.type("at")
    assert at.lines[-1].strip().startswith("at status")
    for line, said in [
        ("at quit", "module unload gcs_plugin.mavproxy_anytraverse"),
        ("at x", "is no command (type `at help`)"),
        ("at answer", "is no command"),
        ("at forget call", "`at forget call 7`"),
    ]:
        at.type(line)
        assert said in at.lines[-1]


def test_open_calls_and_words_complete(proxy: Make, thing_call: CallReport) -> None:
    at = proxy(thing_call)
    complete = at.state.completion_functions
    assert complete["(AT_CALL)"]("") == ["7", "go", "stay", "look"]
    assert complete["(AT_WORD)"]("") == ["grass"]


def test_a_mistake_inside_is_told_once_and_the_rest_goes_on(
    proxy: Make, thing_call: CallReport, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = proxy(None)
    receive = at.module._client.receive

    def broken(message: Any, now: float) -> None:
        if message.get_type() == "TUNNEL" and message.payload_type == ids.TUNNEL_SUMMARY:
            raise RuntimeError("out of cheese")
        receive(message, now)

    monkeypatch.setattr(at.module._client, "receive", broken)
    at.rovers[0].call = thing_call
    at.run(2.0)
    assert sum("RuntimeError: out of cheese" in line for line in at.lines) == 1
    assert any("C7 unknown thing" in line for line in at.lines)


def test_unloading_leaves_nothing_behind_and_names_what_is_given_up(
    proxy: Make, thing_call: CallReport
) -> None:
    at = proxy(thing_call)
    at.run(4.0, silent=True)
    at.type("at go")
    at.module.unload()
    assert (at.state.command_map, at.state.completions, at.state.completion_functions) == ({}, {}, {})
    assert at.state.unloaded
    assert "answer to 7 is not acknowledged" in at.lines[-1]


def test_what_is_told_to_another_ground_station_is_not_for_this_one(proxy: Callable[..., Proxy]) -> None:
    ours = proxy(None)
    ours.rovers[0].hear = lambda _: []
    ours.type("at policy off")
    ours.run(0.5)
    for target in ((255, 190), (255, 230)):
        ack = mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, *target)
        for message in ours.ground.parse(ours.rovers[0].companion.frame(ack)):
            ours.module.mavlink_packet(message)
        before = len(ours.lines)
        ours.run(0.2)
        said = [line for line in ours.lines[before:] if "policy" in line]
        assert bool(said) == (target == (255, 230))


def test_a_word_that_would_turn_its_sign_must_be_typed_twice(proxy: Make) -> None:
    at = proxy(None)
    for _ in range(2):
        assert at.rovers[0].applied == []
        at.type("at set grass -1")
        at.run(1.0)
    assert any("grass was 1: repeat it to turn it" in line for line in at.lines)
    assert at.rovers[0].applied == [(0, ids.Motion.NONE, (SetWord("grass", -1.0),))]


def test_a_text_that_mavproxy_prints_itself_is_not_printed_again_but_counts(
    proxy: Make, thing_call: CallReport
) -> None:
    at = proxy(thing_call)
    at.module.target = 1, 191
    for message in at.ground.parse(at.rovers[0].text("C7 unknown 91% in yellow frame, over 25% calls")):
        at.module.mavlink_packet(message)
    at.run(2.0)
    assert not any("says" in line for line in at.lines), at.lines
    at.type("at calls")
    assert "unknown 91% in yellow frame" in at.lines[-1], "its figures are known"
    at.module.target = 2, 1
    for message in at.ground.parse(at.rovers[0].text("C7 holding")):
        at.module.mavlink_packet(message)
    at.run(3.0)
    assert any('says "C7 holding"' in line for line in at.lines), "of another vehicle MAVProxy prints nothing"


@pytest.mark.parametrize("first", ["companion", "autopilot"])
def test_a_text_that_the_script_on_the_autopilot_repeats_is_printed_by_mavproxy_alone(
    proxy: Make, first: str
) -> None:
    at = proxy(None)
    own = at.rovers[0].text("C7 holding")
    repeated = at.rovers[0].autopilot.frame(mavlink.MAVLink_statustext_message(3, b"C7 holding"))
    for frame in (own, repeated) if first == "companion" else (repeated, own):
        for message in at.ground.parse(frame):
            at.module.mavlink_packet(message)
        at.run(0.5)
    at.run(3.0)
    assert not any("C7 holding" in line for line in at.lines), at.lines
    at.run(60.0)
    for message in at.ground.parse(own_again(at)):
        at.module.mavlink_packet(message)
    at.run(3.0)
    assert any('says "C7 holding"' in line for line in at.lines), "the script is silent now"


def own_again(at: Proxy) -> bytes:
    told: bytes = at.rovers[0].text("C7 holding")
    return told
