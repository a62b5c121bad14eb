"""Whoever turns the sign of a word, all grounds are told, and who did it."""

from __future__ import annotations

import pytest

from anytraverse.operations import ForgetCall, ForgetWord, SetWord, Tap
from companion.wire.answers import Answer, Via
from companion.wire.ids import PAGE_SENDER, Motion
from tests.anytraverse.conftest import AHEAD
from tests.companion.daemon.rig import Rig

BOX = (AHEAD.left, AHEAD.top, AHEAD.right, AHEAD.bottom)


def turned(rig: Rig) -> list[str]:
    return [text for text in rig.texts if "turned" in text]


def test_a_word_turned_by_an_answer_is_told_with_its_sender(held: Rig) -> None:
    held.word(1, "rock", 0.5, Motion.GO)
    held.see(0.5, "drum")
    assert turned(held) == ["rock turned: -1 to +0.5, by 255/190"]


def test_an_undo_that_turns_a_word_back_is_told(held: Rig) -> None:
    held.word(1, "rock", 0.5, Motion.GO)
    held.see(0.5, "drum")
    held.answer(0, Motion.NONE, ForgetCall(1), SetWord("rock", -1.0), transaction=9)
    held.see(0.5)
    assert turned(held)[1:] == ["rock turned: +0.5 to -1, by 255/190"]


def test_a_tap_that_turns_a_word_is_told(held: Rig) -> None:
    call = held.calls.call
    assert call is not None
    held.answer(1, Motion.NONE, Tap(call.frame_id, BOX, "grass", -1.0))
    held.see(0.5, "drum")
    assert turned(held) == ["grass turned: +1 to -1, by 255/190"]


def test_a_parameter_that_turns_a_word_is_told(rig: Rig) -> None:
    rig.set("AT_W_GRASS", 0.4)
    rig.see(0.3)
    assert turned(rig) == []
    rig.set("AT_W_GRASS", -0.4)
    rig.see(0.3)
    assert turned(rig) == ["grass turned: +0.4 to -0.4, by 255/190"]


def test_a_word_that_was_out_of_use_is_told_when_it_comes_back_turned(rig: Rig) -> None:
    rig.answer(0, Motion.NONE, ForgetWord("rock"))
    rig.see(0.3)
    assert rig.daemon.status.state_file()["given"] == {"rock": -1.0}
    rig.answer(0, Motion.NONE, SetWord("rock", 1.0), transaction=8)
    rig.see(0.3)
    assert turned(rig) == ["rock turned: -1 to +1, by 255/190"]
    assert rig.daemon.status.state_file()["given"] == {}


def test_somebody_at_the_rovers_own_page_is_named(rig: Rig) -> None:
    answer = Answer(0, Motion.NONE, (SetWord("rock", 1.0),), transaction=9, sender=PAGE_SENDER, via=Via.PAGE)
    rig.daemon.answer_handler.receive(answer, rig.clock())
    rig.see(0.3)
    assert turned(rig) == ["rock turned: -1 to +1, by page"]


@pytest.mark.parametrize("weight", [-1.0, -0.2])
def test_a_weight_that_keeps_its_sign_is_not_told(rig: Rig, weight: float) -> None:
    rig.word(0, "rock", weight)
    rig.see(0.3)
    assert turned(rig) == []
