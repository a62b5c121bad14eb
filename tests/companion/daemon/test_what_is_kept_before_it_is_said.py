"""An acknowledged answer, an announced id: on disk before they leave, or said not to be."""

from __future__ import annotations

import sqlite3

import pytest

from companion.journal import Journal
from companion.wire.answers import SetWord
from companion.wire.ids import Motion, Result
from tests.companion.daemon.rig import HOLD, Rig, spoil

GO = Motion.GO


def on_disk(rig: Rig) -> Journal:
    """What another process would find now."""
    rig.journal.close()
    return Journal(rig.folder)


def test_an_acknowledged_word_and_its_call_are_on_disk_when_the_acknowledgement_leaves(held: Rig) -> None:
    held.word(1, "drum", -1.0, GO)
    while not held.acks:
        held.see(0.1, "drum")
    journal = on_disk(held)
    memory, calls = journal.load_memory(), journal.load_supervision()
    assert memory is not None
    assert memory.preferences["drum"] == -1.0
    assert [entry.call_id for entry in memory.history] == [0, 1]
    assert calls is not None
    assert calls["call"]["answered"]
    journal.close()


def test_an_id_is_on_disk_before_anybody_hears_it(rig: Rig) -> None:
    while rig.state[1] == 0:
        rig.see(0.1, "drum")
    journal = on_disk(rig)
    calls = journal.load_supervision()
    assert calls is not None
    assert (calls["last_id"], calls["call"]["id"], calls["hold"]["id"]) == (1, 1, 1)
    assert journal.load_frame() is not None
    journal.close()


def test_with_a_full_disk_calls_go_on_and_it_is_said_once(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(rig, monkeypatch, "save_supervision", "save_memory", "save_frame")
    rig.see(6.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == HOLD
    assert rig.texts.count("Journal cannot be written, disk? Not remembered") == 1


def test_what_cannot_be_kept_for_a_reason_that_nobody_foresaw_ends_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def torn(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(rig.journal, "save_frame", torn)
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == HOLD


def test_a_go_on_a_full_disk_is_taken_and_said_not_to_be_remembered(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(held, monkeypatch, "save_supervision", "save_memory")
    held.answer(1, GO)
    held.see(2.0)
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert "not remembered" in held.acks[-1].text
    assert held.stage.mode != HOLD, "a full disk alone is no fault"


def test_a_stay_that_the_disk_did_not_take_says_so(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(held, monkeypatch, "save_supervision")
    held.answer(1, Motion.STAY)
    held.see(0.5, "drum")
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert held.acks[-1].text.startswith("not remembered (disk?): ")


def test_a_word_that_covers_nothing_and_is_not_on_disk_says_so(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(held, monkeypatch, "save_memory")
    held.word(1, "trail", 1.0)
    held.see(0.5, "drum")
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED


def test_words_without_a_call_that_are_not_on_disk_say_so(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(rig, monkeypatch, "save_memory")
    rig.word(0, "drum", -1.0)
    rig.see(0.5)
    assert rig.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert "not remembered" in rig.acks[-1].text


def test_the_disk_is_not_hammered_while_it_is_full(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = []

    def full(*_: object) -> None:
        tries.append(rig.clock.now)
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("companion.journal.journal.write_memory", full)
    rig.set("AT_W_DRUM", -1.0)
    rig.see(5.0)
    assert 2 <= len(tries) <= 11
    monkeypatch.undo()


def test_once_there_is_room_again_all_is_kept_and_said(held: Rig) -> None:
    with pytest.MonkeyPatch.context() as patched:
        spoil(held, patched, "save_memory", "save_supervision")
        held.word(1, "drum", -1.0)
        held.see(3.0, "drum")
    held.see(6.0, "drum")
    assert "Journal is written again" in held.texts
    held.restart()
    assert held.conversation.words["drum"] == -1.0


def test_frame_and_answers_that_found_no_room_are_kept_once_there_is_some(rig: Rig) -> None:
    def full(*_: object) -> None:
        raise OSError("disk full")

    with pytest.MonkeyPatch.context() as patched:
        spoil(rig, patched, "_append")
        patched.setattr("companion.journal.journal.write_durably", full)
        rig.see(3.0, "drum")
        rig.answer(1, Motion.STAY)
        rig.see(0.2, "drum")
        rig.answer(1, Motion.LOOK_AGAIN, transaction=8)
        rig.see(1.0, "drum")
    rig.see(8.0, "drum")
    assert rig.texts.count("Journal is written again") == 1
    assert rig.journal.load_frame() is not None
    assert [one["motion"] for one in rig.journal.answers(1)] == ["stay", "look_again"]


def test_an_answer_asked_again_is_applied_once(held: Rig) -> None:
    for _ in range(3):
        held.answer(1, GO, SetWord("drum", 0.5))
        held.see(0.4, "drum")
    assert [ack.text for ack in held.acks] == [held.acks[0].text] * 3
    memory = held.journal.load_memory()
    assert memory is not None
    assert len(memory.history) == 2


def test_an_answer_asked_again_after_a_restart_is_known(held: Rig) -> None:
    held.word(1, "drum", 0.5, GO)
    held.see(4.0, "drum")
    assert held.acks[-1].result is Result.APPLIED
    assert held.state[1] == 0
    held.restart()
    held.see(1.0, ground="trail")
    held.see(3.0, ground="trail")
    number = held.state[1]
    assert number > 1, "another call is open now"
    held.word(1, "drum", 0.5, GO)
    held.see(0.5, ground="trail")
    assert (held.acks[-1].target, held.acks[-1].result) == (1, Result.APPLIED)
    assert held.state[1] == number
