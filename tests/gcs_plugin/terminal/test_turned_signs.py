"""A line that turns the sign of a word must be typed twice, whether a parameter holds that word or not."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from anytraverse.operations import OtherPlace, SetWord, Tap
from companion.wire.call_report import CallReport
from companion.wire.ids import Motion, Stage
from gcs_plugin.terminal.script import Script
from tests.gcs_plugin.terminal.test_session import Desk, Make, desk

__all__ = ["desk"]
STATE = {"state": "calling", "words": {"grass": 1, "old water": -1}, "given": {"mud": -0.5, "gravel": 1}}
GRASS = "grass was 1: repeat it to turn it, then grass becomes not drivable; nothing was sent"


def answers(at: Any) -> list[Any]:
    found: list[Any] = at.rovers[0].applied
    return found


def test_a_word_with_a_parameter_is_turned_by_the_same_line_once_more(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(thing_call)
    at.type("tap grass -1 go")
    assert at.paper.problems == [GRASS]
    assert answers(at) == []
    at.type("words")
    at.type("tap grass -1 go")
    ((_, motion, (tap,)),) = answers(at)
    assert motion is Motion.GO
    assert isinstance(tap, Tap)
    assert (tap.word, tap.weight) == ("grass", -1.0)


def test_another_line_between_begins_anew(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call, stage=Stage.ANSWERED)
    for line in ("grass: -1", "grass: 0.5", "grass: -1", "7 grass: -0.5"):
        at.type(line)
    assert [operations for _, _, operations in answers(at)] == [(SetWord("grass", 0.5),)]
    assert at.paper.problems == [GRASS] * 3


def test_a_word_that_no_parameter_holds_or_that_is_out_of_use_is_asked_about_too(
    desk: Make, thing_call: CallReport
) -> None:
    at = desk(thing_call, stage=Stage.ANSWERED)
    at.rovers[0].files = {"/state.json": json.dumps(STATE).encode()}
    at.run(70.0)  # before, nobody answered
    assert not at.client.busy
    for line in ("old water: 1, go", "mud: 0.5, go", "gravel: 0.3, go", "Old  Water: -0.5", "sand: 1"):
        at.type(line)
    assert [operations[0] for _, _, operations in answers(at)] == [
        SetWord("gravel", 0.3),
        SetWord("old water", -0.5),
        SetWord("sand", 1.0),
    ]
    assert [problem.partition(":")[0] for problem in at.paper.problems] == [
        "old water was -1",
        "mud was -0.5",
    ]


def test_before_the_words_are_read_a_table_waits_and_a_person_is_asked(
    tiny_rover: Callable[..., Any], speaker: Callable[..., Any], thing_call: CallReport
) -> None:
    rover = tiny_rover(1, thing_call)
    told, rover.files = {"/state.json": json.dumps(STATE).encode()}, {}
    table = Script.parse('[{"answer": "old water: 1, go"}, {"answer": "go", "kind": "hold"}]')
    at = Desk(speaker(255, 190), rover, script=table)
    at.run(3.0)
    assert (answers(at), at.paper.problems) == ([], [])
    at.type("7 old water: 1")
    assert [problem.partition(":")[0] for problem in at.paper.problems] == ["old water is not read yet"]
    rover.files = told
    at.run(70.0)
    assert answers(at) == []
    assert at.paper.problems[-1].startswith("old water was -1")
    assert at.paper.problems[-1].endswith("A table turns no sign: type it yourself")


def test_a_place_that_turned_a_word_is_refused_by_the_same_line_once_more(desk: Make) -> None:
    at = desk(None)
    matched = {"call": 5, "similarity": 0.97, "changed": {"old water": [1, -1], "grass": [0.5, 1]}}
    at.rovers[0].files = {"/state.json": json.dumps({**STATE, "known_place": matched}).encode()}
    at.run(70.0)
    at.type("other place 5")
    assert [problem.partition(";")[0] for problem in at.paper.problems] == [
        "old water was -1: repeat it to turn it, then old water becomes drivable"
    ]
    assert answers(at) == []
    at.type("other place 5")
    assert [operations for _, _, operations in answers(at)] == [(OtherPlace(5),)]


def test_a_picture_that_is_asked_for_goes_before_the_words(desk: Make) -> None:
    at = desk(None)
    kept: dict[str, bytes] = {}

    def keep(name: str, content: bytes) -> str:
        kept[name] = content
        return name

    at.session._keep = keep
    at.rovers[0].files = {"/calls/7.jpg": bytes(range(200)), "/state.json": json.dumps(STATE).encode()}
    at.type("picture 7")
    at.run(5.0)
    assert list(kept.values()) == [bytes(range(200))]
    at.run(80.0)
    assert at.client.rovers[1].given()["mud"] == -0.5


def test_a_known_word_without_a_weight_is_proposed_with_its_own(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call)
    for line in ("Grass, go", "sand, go"):
        at.type(line)
    assert answers(at) == []
    assert [problem.rpartition("write it as ")[2] for problem in at.paper.problems] == [
        "`grass: 1`",
        "`bush: -1`",
    ]


def test_a_table_turns_no_sign_and_a_person_still_may(desk: Make, thing_call: CallReport) -> None:
    at = desk(thing_call, script=[{"answer": "grass: -1, go", "after": 2}])
    assert answers(at) == []
    assert at.paper.problems == [f"{GRASS}. A table turns no sign: type it yourself"]
    at.type("grass: -1, go")
    at.type("grass: -1, go")
    assert len(answers(at)) == 1
