"""The labels answer a call as somebody would who sees them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.datasets import open_dataset
from anytraverse.history import Place
from anytraverse.operations import SetWord, Tap
from anytraverse.regions import Box
from anytraverse.roi import Tile
from companion.calls.decisions import Call
from companion.config import load_config
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import LabelledDrive, LabelOperator
from companion.desk.tuning.trial import Combination
from companion.vision.warm_up import load_engine
from companion.wire.answers import Answer
from companion.wire.ids import Motion

CRATE = Box(0.55, 0.8, 0.65, 0.95)
GRAVEL = Box(0.4, 0.55, 0.45, 0.65)


@pytest.fixture(scope="module")
def called(drive: Path) -> tuple[DriveJudge, Call, DriveFrame, LabelOperator]:
    """A call that is open, in the drive's second frame."""
    config = load_config(drive.parent / "companion.toml")
    engine, _ = load_engine(config, None)
    strict = Combination(0.6, 0.01, None, Box(0.35, 0.46, 0.65, 0.95)).applied(engine.settings)
    judge = DriveJudge(config, AnyTraverse(engine.perceiver, strict, engine.memory))
    dataset = open_dataset(f"folder:{drive}")
    for frame in LabelledDrive(dataset, 10.0).frames():
        judged = judge.judge(frame)
        if judged is not None and judged.opened is not None:
            return judge, judged.opened, frame, LabelOperator.of(dataset, ["gravel"])
    raise AssertionError("no call opened")


def meant(call: Call, reasons: set[Reason], box: Box) -> Call:
    """The same call for other reasons, of another place."""
    assert call.seen is not None
    assert call.seen.roi is not None
    roi = replace(call.seen.roi, worst_tile=Tile(box, 0.9), named_tile=None)
    return replace(call, reasons=reasons, seen=replace(call.seen, roi=roi, findings=()))


Called = tuple[DriveJudge, Call, DriveFrame, LabelOperator]


@pytest.mark.slow
def test_a_thing_that_the_perceiver_cannot_ground_is_tapped_where_the_call_points(called: Called) -> None:
    judge, call, frame, operator = called
    thing = meant(call, {Reason.UNKNOWN_OBJECT}, CRATE)
    answer = operator(judge, thing, frame)
    box = (CRATE.left, CRATE.top, CRATE.right, CRATE.bottom)
    assert answer.operations == (Tap(call.frame_id, box, "crate", -1.0),)
    assert answer.motion is Motion.GO


def test_a_tapped_thing_that_is_asked_about_again_is_tapped_again(drive: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    judge, dataset = DriveJudge(config, load_engine(config, None)[0]), open_dataset(f"folder:{drive}")
    operator = LabelOperator.of(dataset, ["gravel"])
    for frame in LabelledDrive(dataset, 10.0).frames():
        judged = judge.judge(frame)
        if judged is not None and judged.opened is not None:
            call = meant(judged.opened, {Reason.UNKNOWN_OBJECT}, CRATE)
            first = operator(judge, call, frame)
            judge.answer(first, frame.at)
            assert "crate" in judge.engine.memory.preferences
            assert operator(judge, call, frame) == first
            return
    raise AssertionError("no call opened")


def test_ground_is_named_with_the_weight_of_its_class(called: Called) -> None:
    judge, call, frame, operator = called
    answer = operator(judge, meant(call, {Reason.UNKNOWN_OBJECT}, GRAVEL), frame)
    assert answer.operations == (SetWord("gravel", 1.0),)


def test_of_a_scene_all_classes_without_a_word_are_named(called: Called) -> None:
    judge, call, frame, operator = called
    answer = operator(judge, meant(call, {Reason.UNKNOWN_SCENE}, CRATE), frame)
    assert answer.operations == (SetWord("gravel", 1.0),)  # `tree` has a word, and a crate cannot be named


def test_nothing_is_named_that_a_word_in_use_means(called: Called) -> None:
    judge, call, frame, operator = called
    answer = operator(judge, meant(call, {Reason.UNKNOWN_OBJECT}, Box(0.4, 0.1, 0.6, 0.3)), frame)
    assert answer.operations == ()


def test_what_is_asked_about_is_told_by_its_class(called: Called) -> None:
    _, call, frame, operator = called
    assert operator.asked(meant(call, {Reason.UNKNOWN_OBJECT}, CRATE), frame) == "crate"
    assert operator.asked(meant(call, {Reason.UNKNOWN_SCENE}, CRATE), frame) is None


def test_an_answered_scene_keeps_where_its_frame_was_taken(drive: Path) -> None:
    config = load_config(drive.parent / "companion.toml")
    judge, at = DriveJudge(config, load_engine(config, None)[0]), Place(50.0, 8.0)
    for frame in LabelledDrive(open_dataset(f"folder:{drive}"), 10.0).frames():
        judged = judge.judge(replace(frame, place=at, travelled=frame.at))
        if judged is not None and judged.opened is not None:
            judge.answer(Answer(0, Motion.GO), frame.at)
            break
    assert [entry.place for entry in judge.engine.memory.history][-1] == at
