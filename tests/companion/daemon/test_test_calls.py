"""A test call: raised by a file in the state folder, told like a call, answered by anything, harmless."""

from __future__ import annotations

import os
import time
from typing import Any

import pytest

from anytraverse.operations import SetWord
from companion.calls.snapshot import snapshot
from companion.daemon.trial_call import ANSWERED_WITHIN, REQUEST
from companion.wire.call_report import CallReport
from companion.wire.ids import TUNNEL_CALL, Kind, Motion, Outcome, Policy, Reasons, Result, Stage
from tests.companion.daemon.rig import AUTO, MakeRig, Rig


def ask(rig: Rig) -> int:
    """As `companion check --dry-run` asks."""
    path = rig.folder / REQUEST
    path.touch()
    return path.stat().st_mtime_ns


def told(rig: Rig) -> list[CallReport]:
    """The test calls' data that the ground heard."""
    heard = [CallReport.unpack(payload) for payload in rig.stage.tunnels(TUNNEL_CALL)]
    return [data for data in heard if data.test]


def status(rig: Rig) -> dict[str, Any]:
    """What became of it."""
    said = rig.daemon.status.figures()["test_call"]
    assert isinstance(said, dict)
    return said


def test_a_test_call_is_told_like_a_call_and_says_that_it_is_one(rig: Rig) -> None:
    asked = ask(rig)
    rig.see(2.0)
    assert "C1 TEST call, nothing is wrong: go/stay/word" in rig.texts
    data = told(rig)[-1]
    assert (data.id, data.kind, data.stage, data.reasons) == (1, Kind.CALL, Stage.OPEN, Reasons.NONE)
    assert not data.holding
    assert rig.state == ("OK", 1), "nothing is wrong, and something is asked"
    assert (status(rig)["asked"], status(rig)["state"]) == (asked, "open")
    assert not (rig.folder / REQUEST).exists()


@pytest.mark.slow
@pytest.mark.parametrize("motion", [Motion.GO, Motion.STAY, Motion.LOOK_AGAIN])
def test_any_answer_closes_it_and_says_who_answered_and_when(rig: Rig, motion: Motion) -> None:
    ask(rig)
    rig.see(3.0)
    rig.answer(1, motion)
    rig.see(4.0)
    (ack,) = rig.acks
    assert (ack.target, ack.result, ack.stage, ack.outcome) == (
        1,
        Result.APPLIED,
        Stage.CLOSED,
        Outcome.ANSWERED,
    )
    assert "C1 TEST answered by 255/190 after 3." in ack.text
    assert any(text.startswith("C1 TEST answered by 255/190 after") for text in rig.texts)
    assert [data.outcome for data in told(rig)[-3:]] == [Outcome.ANSWERED] * 3
    assert rig.state == ("OK", 0)
    assert (status(rig)["state"], status(rig)["by"]) == ("answered", [255, 190])


def test_it_holds_nothing_and_teaches_nothing(rig: Rig) -> None:
    before, memory = rig.vision.words, rig.engine.memory
    ask(rig)
    rig.see(3.0)
    assert rig.stage.mode == AUTO
    assert rig.calls.call is None
    rig.answer(1, Motion.GO, SetWord("drum", -1.0))
    rig.see(2.0)
    (ack,) = rig.acks
    assert ack.result is Result.REFUSED
    assert "a test teaches no words" in ack.text
    assert rig.vision.words == before
    assert rig.engine.memory.history == memory.history
    assert rig.engine.memory.reference is memory.reference
    assert not rig.calls.reason_filter.things
    assert rig.stage.mode == AUTO


def test_the_current_one_is_the_test_once_it_could_be_read(rig: Rig) -> None:
    ask(rig)
    rig.see(1.0)
    rig.answer(0, Motion.GO, transaction=8)
    rig.see(2.0)
    rig.answer(0, Motion.GO, transaction=9)
    rig.see(1.0)
    assert [(ack.target, ack.result) for ack in rig.acks] == [(1, Result.STALE), (1, Result.APPLIED)]


def test_words_without_a_call_are_taken_as_ever_while_a_test_is_open(rig: Rig) -> None:
    ask(rig)
    rig.see(1.0)
    rig.word(0, "drum", -1.0)
    rig.see(1.0)
    assert rig.acks[-1].result is Result.APPLIED
    assert "drum" in rig.vision.words
    assert status(rig)["state"] == "open"


@pytest.mark.slow
def test_nobody_who_answers_ends_it_after_a_minute(rig: Rig) -> None:
    ask(rig)
    rig.see(ANSWERED_WITHIN + 3.0)
    assert "C1 TEST over: nobody answered" in rig.texts
    assert told(rig)[-1].outcome is Outcome.PASSED
    assert status(rig)["state"] == "unanswered"


def test_a_real_call_ends_a_test_at_once_and_takes_the_next_id(rig: Rig) -> None:
    ask(rig)
    rig.see(2.0)
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 2)
    assert "C1 TEST over: a real call came" in rig.texts
    assert rig.stage.mode != AUTO, "held as ever"
    assert status(rig)["state"] == "cut short"
    rig.answer(1, Motion.GO)
    rig.see(0.5)
    assert rig.acks[-1].result is Result.STALE, "the answer to the test is none to the call"


def test_no_test_while_a_call_is_open(held: Rig) -> None:
    asked = ask(held)
    held.see(2.0, "drum")
    assert status(held) == {
        "asked": asked,
        "id": 0,
        "state": "refused",
        "text": "C1 is open: answer it first",
    }
    assert told(held) == []
    assert snapshot(held.calls)["last_id"] == 1, "no id was spent"


def test_a_second_one_is_refused_and_the_first_goes_on_with_a_status_of_its_own(rig: Rig) -> None:
    first = ask(rig)
    rig.see(2.0)
    second = ask(rig)
    rig.see(2.0)
    assert (status(rig)["asked"], status(rig)["state"]) == (first, "open")
    assert status(rig)["refused"] == {"asked": second, "text": "C1 is open: answer it first"}
    rig.answer(1, Motion.GO)
    rig.see(1.0)
    assert (status(rig)["asked"], status(rig)["id"], status(rig)["state"]) == (first, 1, "answered")


def test_an_answer_that_is_sent_again_is_acknowledged_as_before(rig: Rig) -> None:
    ask(rig)
    rig.see(3.0)
    for _ in range(2):
        rig.answer(1, Motion.GO, transaction=5)
        rig.see(1.0)
    assert [ack.result for ack in rig.acks] == [Result.APPLIED] * 2


def test_two_tests_take_two_ids_one_after_the_other(rig: Rig) -> None:
    for number in (1, 2):
        ask(rig)
        rig.see(2.5)
        rig.answer(number, Motion.GO, transaction=number)
        rig.see(1.0)
    assert [ack.target for ack in rig.acks] == [1, 2]


def test_an_id_is_kept_before_it_is_told_and_never_used_again(rig: Rig) -> None:
    ask(rig)
    rig.see(1.0)
    rig.restart()
    rig.see(1.0)
    assert rig.state == ("OK", 0), "a test does not outlive a restart"
    ask(rig)
    rig.see(1.0)
    assert told(rig)[-1].id > 1


def test_an_old_request_is_taken_away_and_ignored(rig: Rig) -> None:
    ask(rig)
    os.utime(rig.folder / REQUEST, (time.time() - 60,) * 2)
    rig.see(1.0)
    assert not (rig.folder / REQUEST).exists()
    assert told(rig) == []


def test_a_request_by_another_user_is_ignored(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    ask(rig)
    if os.geteuid() == 0:
        os.chown(rig.folder / REQUEST, 12345, 12345)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    rig.see(1.0)
    assert told(rig) == []


def test_a_companion_that_only_reports_can_be_tried_too(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    ask(rig)
    rig.see(1.0)
    assert told(rig)
