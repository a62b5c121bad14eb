"""An operator at work, in virtual time: which rover, which call, and the script beside the person."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import pytest

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap
from companion.wire import ids
from companion.wire.answers import CancelIncident, PackIncident
from companion.wire.call_report import CallReport
from companion.wire.ids import words_hash
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.script import Script
from gcs_plugin.terminal.session import Session
from gcs_plugin.terminal.wording import words_lines


class Paper:
    """An output that remembers."""

    def __init__(self) -> None:
        self.events: list[ev.Event] = []
        self.said: list[str] = []
        self.problems: list[str] = []
        self.lines_typed: list[str] = []

    def started(self, link: str) -> None:
        raise NotImplementedError

    def event(self, event: ev.Event, now: float, *, several: bool) -> None:  # noqa: ARG002
        self.events.append(event)

    def say(self, lines: Iterable[str]) -> None:
        self.said += lines

    def problem(self, text: str) -> None:
        self.problems.append(text)

    def typed(self, line: str) -> None:
        self.lines_typed.append(line)

    def end(self, totals: dict[str, Any]) -> None:
        raise NotImplementedError


class Desk:
    """Rovers, a client and a session, and time that runs when asked to."""

    def __init__(self, ground: Any, *rovers: Any, script: Script | None = None) -> None:
        self.rovers = rovers
        self.ground = ground
        self.client = OperatorClient()
        self.paper = Paper()
        self.session = Session(self.client, self.paper, script)
        self.now = 0.0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            frames = [frame for rover in self.rovers for frame in rover.speak()]
            for message in self.client.outgoing(self.now):
                for rover in self.rovers:
                    if message.target_system == rover.system:
                        frames += rover.hear(self.ground.frame(message))
            for message in self.ground.parse(b"".join(frames)):
                self.client.receive(message, self.now)
            self.session.step(self.now)

    def type(self, line: str) -> None:
        self.session.type(line, self.now)
        self.run(1.0)


Make = Callable[..., Desk]


@pytest.fixture
def desk(tiny_rover: Callable[..., Any], speaker: Callable[..., Any]) -> Make:
    def made(
        *calls: CallReport | None,
        script: list[dict[str, Any]] | None = None,
        result: ids.Result = ids.Result.APPLIED,
        stage: ids.Stage = ids.Stage.CLOSED,
    ) -> Desk:
        rovers = [tiny_rover(system, call) for system, call in enumerate(calls, 1)]
        for rover in rovers:
            rover.result, rover.stage_after = result, stage
        table = None if script is None else Script.parse(json.dumps(script))
        at = Desk(speaker(255, 190), *rovers, script=table)
        at.run(3.0)
        return at

    return made


def test_an_answer_goes_to_the_current_call(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call)
    at.type("go")
    assert at.rovers[0].applied == [(7, ids.Motion.GO, ())]


@pytest.mark.parametrize("line", ["go", "tap drum -1 go", "bush: -1"])
def test_an_answer_without_an_id_is_not_taken_for_a_call_that_nobody_has_read(
    desk: Make, thing_call: CallReport, line: str
) -> None:
    at = desk(thing_call)
    at.rovers[0].call = replace(thing_call, id=8, frame_id=5000)
    at.run(0.1)
    at.type(line)
    assert at.rovers[0].applied == []
    assert at.paper.problems == ["8 is new, so nothing was sent: read it, then type that again"]
    at.type(f"8 {line}")
    assert [target for target, _, _ in at.rovers[0].applied] == [8]


def test_that_a_place_is_another_one_concerns_no_call_and_is_sent_at_once(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(thing_call)
    at.rovers[0].call = replace(thing_call, id=8, frame_id=5000)
    at.run(0.1)
    at.type("other place 3")
    assert at.rovers[0].applied == [(0, ids.Motion.NONE, (OtherPlace(3),))]
    assert at.paper.problems == []


def test_an_incident_file_is_asked_for_and_cancelled_while_a_call_is_new(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(thing_call)
    at.rovers[0].call = replace(thing_call, id=8, frame_id=5000)
    at.run(0.1)
    at.type("incident 7")
    at.type("cancel incident C7")
    none = ids.Motion.NONE
    assert at.rovers[0].applied == [(0, none, (PackIncident(7),)), (0, none, (CancelIncident(7),))]
    assert at.paper.problems == []


def test_nor_for_one_of_which_only_the_heartbeat_has_told(desk: Make, thing_call: CallReport) -> None:
    at = desk(None)
    at.rovers[0].call = thing_call
    for message in at.ground.parse(at.rovers[0].heartbeat()):
        at.client.receive(message, at.now)
    at.session.type("go", at.now)
    assert at.paper.problems == ["7 is new, so nothing was sent: read it, then type that again"]


def test_a_call_that_was_open_before_we_came_is_not_called_nothing(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(None)
    at.rovers[0].call = thing_call
    for message in at.ground.parse(at.rovers[0].heartbeat()):
        at.client.receive(message, at.now)
    at.session.type("calls", at.now)
    assert at.paper.said == ["rover 1: 7 is open; what it is about is told again within 10 s"]
    at.type("calls")
    at.type("calls")
    assert "C7 unknown thing ahead" in at.paper.said[-1]


def test_words_without_a_call_are_taken_at_any_time(desk: Make) -> None:
    at = desk(None)
    at.type("bush: -1; forget rock; forget call 3; new episode")
    operations = (SetWord("bush", -1.0), ForgetWord("rock"), ForgetCall(3), NewEpisode())
    assert at.rovers[0].applied == [(0, ids.Motion.NONE, operations)]


def test_a_tap_takes_the_frame_of_the_call_and_its_worst_tile(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call, stage=ids.Stage.ANSWERED)
    at.type("tap drum -1")
    at.type("7 tap barrel -0.5 0.1 0.2 0.3 0.4")
    assert [operations for _, _, operations in at.rovers[0].applied] == [
        (Tap(4711, (0.41, 0.55, 0.6, 0.81), "drum", -1.0),),
        (Tap(4711, (0.1, 0.2, 0.3, 0.4), "barrel", -0.5),),
    ]


def test_what_fits_nothing_is_refused_with_what_to_do(desk: Make, thing_call: CallReport) -> None:
    at = desk(None)
    for line, said in [
        ("go", "words alone are taken"),
        ("tap drum -1", "a word works"),
        ("rover 9 go", "rover 9 is not heard (heard: 1)"),
        ("rover 9", "rover 9 is not heard"),
        ("12 tap drum -1", "not told in full yet"),
    ]:
        at.type(line)
        assert said in at.paper.problems.pop(), line
    at.rovers[0].call = replace(thing_call, worst_tile_box=None)
    at.run(2.5)
    at.type("tap drum -1")
    assert "give the box" in at.paper.problems.pop()
    at.type("go")
    at.type("7 go")
    assert "closed already" in at.paper.problems.pop()
    assert at.rovers[0].applied == [(7, ids.Motion.GO, ())]


def test_a_policy_goes_to_the_rover_that_is_meant(desk: Make) -> None:
    at = desk(None, None)
    at.type("policy off")
    assert "rovers 1, 2 are heard" in at.paper.problems.pop()
    at.type("rover 2 policy off")
    assert [rover.policies_asked for rover in at.rovers] == [[], [ids.Policy.OFF]]
    at.type("policy fast")
    assert at.paper.problems == [
        "which policy? Write it as `policy hold`; there are report, shadow, hold, off, guide"
    ]


def test_before_any_rover_is_heard_a_line_says_so(desk: Make) -> None:
    at = desk()
    at.type("go")
    assert at.paper.problems == ["no rover is heard yet: is the link right, and does the companion run?"]
    at.type("status")
    assert at.paper.said == ["no rover is heard yet"]


def test_with_several_rovers_a_line_must_name_one_or_one_is_selected(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(thing_call, thing_call)
    at.type("go")
    assert "`rover 1 go`" in at.paper.problems.pop()
    at.type("rover 2 go")
    assert [len(rover.applied) for rover in at.rovers] == [0, 1]
    at.type("rover 1")
    at.type("stay")
    assert at.rovers[0].applied == [(7, ids.Motion.STAY, ())]
    assert at.paper.problems == []


def test_the_script_tries_its_next_rule_when_an_answer_did_not_cover(
    desk: Make, thing_call: CallReport
) -> None:
    rules = [{"answer": "bush: -1 go"}, {"answer": "tap drum -1 go"}]
    at = desk(thing_call, script=rules, result=ids.Result.NOT_COVERED, stage=ids.Stage.OPEN)
    at.run(10.0)
    assert at.paper.lines_typed == ["rover 1 7 bush: -1 go", "rover 1 7 tap drum -1 go"]
    assert len(at.rovers[0].applied) == 2


def test_the_script_leaves_a_call_alone_once_its_answer_is_taken(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call, script=[{"answer": "stay"}, {"answer": "go"}], stage=ids.Stage.ANSWERED)
    at.run(5.0)
    assert at.paper.lines_typed == ["rover 1 7 stay"]


def test_the_figures_of_a_session(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call)
    at.type("go")
    figures = at.session.totals.record(at.client.rovers, 3.0)
    assert figures["calls"] == 1
    assert (figures["answers_sent"], figures["answers_acknowledged"]) == (1, 1)
    assert figures["closed_by_outcome"] == {"answered": 1}
    assert figures["summaries_received"] == at.rovers[0].sequence
    assert figures["bytes_from_companion"] > 1000
    json.dumps(figures)


def test_words_say_whether_they_are_all(desk: Make) -> None:
    at = desk(None)
    rover = at.client.rovers[1]
    for name, value in (("AT_W_DRY_GRASS", -0.5), ("AT_W_ROCK", -2.0)):
        rover.handle_parameter(name, value)
    at.type("words")
    assert at.paper.said[0] == "rover 1: dry grass: -0.5; grass: 1"
    assert "these are not all" in at.paper.said[1]
    assert rover.summary is not None
    all_of_them = words_hash({"grass": 1.0, "dry grass": -0.5})
    rover.summary = replace(rover.summary, words=all_of_them)
    assert words_lines(rover) == ["rover 1: dry grass: -0.5; grass: 1"]


def test_status_words_calls_and_help_are_said(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call)
    at.run(1.0)
    for line, said in [
        ("status", "90% drivable, 5% unexplained"),
        ("rover 1 calls", "C7 unknown thing ahead"),
        ("words", "grass: 1"),
        ("help", "tap drum -1"),
    ]:
        at.type(line)
        assert said in "\n".join(at.paper.said), line
    at.type("quit")
    assert at.session.quit
