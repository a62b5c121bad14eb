"""An acknowledged answer, an announced id: on disk before they leave, or said not to be."""

from __future__ import annotations

import sqlite3

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.operations import SetWord
from bench.virtual_time import virtual_time
from companion.link.link import Link
from companion.storage import Batch, Journal, JournalError
from companion.vision.checks import BadReportError
from companion.vision.client import VisionResult
from companion.vision.messages import Done
from companion.wire.ids import Motion, Policy, Result
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, Rig, spoil

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
    assert calls["last_id"] >= rig.state[1]
    assert (calls["call"]["id"], calls["hold"]["id"]) == (1, 1)
    assert journal.load_frame(calls["call"]["frame_id"]) is not None
    journal.close()


def test_with_a_full_disk_calls_go_on_and_it_is_said_once(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(rig, monkeypatch)
    rig.see(6.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == HOLD
    assert rig.texts.count("Journal cannot be written, disk? Not remembered") == 1


def test_what_cannot_be_kept_for_a_reason_that_nobody_foresaw_ends_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    spoil(rig, monkeypatch, MemoryError("none left"))
    rig.see(5.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == HOLD
    assert caplog.text.count("journal cannot be written: none left") == 1
    assert rig.writer.errors["journal"] > 5, "it is tried again, and counted"


def test_a_go_on_a_full_disk_is_taken_and_said_not_to_be_remembered(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(held, monkeypatch)
    held.answer(1, GO)
    held.see(2.0)
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert "not remembered" in held.acks[-1].text
    assert held.stage.mode != HOLD, "a full disk alone is no fault"


def test_a_stay_that_the_disk_did_not_take_says_so(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(held, monkeypatch)
    held.answer(1, Motion.STAY)
    held.see(0.5, "drum")
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert held.acks[-1].text.startswith("not remembered (disk?): ")


def test_a_word_that_covers_nothing_and_is_not_on_disk_says_so(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(held, monkeypatch)
    held.word(1, "trail", 1.0)
    held.see(0.5, "drum")
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED


def test_words_without_a_call_that_are_not_on_disk_say_so(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spoil(rig, monkeypatch)
    rig.word(0, "drum", -1.0)
    rig.see(0.5)
    assert rig.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    assert "not remembered" in rig.acks[-1].text


def test_the_disk_is_not_hammered_while_it_is_full(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = []

    def full(*_: object) -> None:
        tries.append(rig.clock.now)
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("companion.storage.journal.write_memory", full)
    rig.set("AT_W_DRUM", -1.0)
    rig.see(5.0)
    assert 2 <= len(tries) <= 11


def test_once_there_is_room_again_all_is_kept_and_said(held: Rig) -> None:
    with pytest.MonkeyPatch.context() as patched:
        spoil(held, patched)
        held.word(1, "drum", -1.0)
        held.see(3.0, "drum")
    held.see(6.0, "drum")
    assert "Journal is written again" in held.texts
    held.restart()
    assert held.vision.words["drum"] == -1.0


def test_frame_and_answers_that_found_no_room_are_kept_once_there_is_some(rig: Rig) -> None:
    with pytest.MonkeyPatch.context() as patched:
        spoil(rig, patched)
        rig.see(3.0, "drum")
        rig.answer(1, Motion.STAY)
        rig.see(0.2, "drum")
        rig.answer(1, Motion.LOOK_AGAIN, transaction=8)
        rig.see(1.0, "drum")
    rig.see(8.0, "drum")
    assert rig.texts.count("Journal is written again") == 1
    assert rig.calls.call is not None
    assert rig.journal.load_frame(rig.calls.call.frame_id) is not None
    assert [one["motion"] for one in rig.journal.answers(1)] == ["stay", "look_again"]


def test_a_frame_that_finds_no_room_keeps_nothing_else_from_being_kept(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit = rig.journal.commit

    def full(batch: Batch) -> None:
        if batch.frame is not None:
            raise JournalError("disk full")
        commit(batch)

    monkeypatch.setattr(rig.journal, "commit", full)
    rig.see(3.0, "drum")
    rig.word(1, "drum", -1.0)
    rig.see(1.0, "drum")
    assert rig.acks[-1].result is Result.APPLIED
    assert (rig.journal.load_supervision() or {})["call"]["answered"]
    assert "Journal cannot be written, disk? Not remembered" in rig.texts


def test_that_signing_timestamps_are_not_stored_is_told_once_and_when_they_are_again(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(Link, "stores_timestamps", False)
        rig.see(3.0)
    rig.see(3.0)
    told = [text for text in rig.texts if text.startswith("Signing times")]
    assert told == ["Signing times cannot be written: check the disk", "Signing times are written again"]


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


@pytest.mark.parametrize("words", [(), (SetWord("drum", 0.5),)], ids=["go alone", "with a word"])
def test_a_go_asked_again_after_a_restart_that_voided_it_is_not_told_to_be_given(
    held: Rig, words: tuple[SetWord, ...]
) -> None:
    held.answer(1, GO, *words)
    while not (held.journal.load_supervision() or {}).get("replies"):
        held.see(0.1, "drum")
    held.restart()
    held.see(0.3, "drum")
    held.answer(1, GO, *words)
    held.see(3.0)
    assert (held.state[1], held.stage.mode) == (1, HOLD)
    assert held.acks[-1].text == "C1 go has lapsed: send it again"


def test_what_changes_nothing_writes_nothing(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Batch] = []
    held.see(1.0, "drum")
    monkeypatch.setattr(held.journal, "commit", written.append)
    held.see(3.0, "drum")
    held.answer(9, GO)
    held.see(0.3, "drum")
    held.word(1, "no such word", -7.0)
    held.hung = True
    held.answer(1, GO, SetWord("drum", 1.0), transaction=8)
    held.wait(2.5)
    held.answer(1, GO, SetWord("drum", 1.0), transaction=9)
    held.wait(0.3)
    results = {ack.result for ack in held.acks}
    assert {Result.STALE, Result.BUSY} <= results
    assert all(batch.memory is None and not batch.rows for batch in written)
    assert len(written) <= 1, "the state of the hold may have changed, once"


def test_all_that_an_answer_led_to_is_one_transaction(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    commit, written = held.journal.commit, list[Batch]()

    def note(batch: Batch) -> None:
        written.append(batch)
        commit(batch)

    monkeypatch.setattr(held.journal, "commit", note)
    held.word(1, "drum", 1.0, GO)
    held.see(0.3, "drum")
    assert held.acks[-1].result is Result.APPLIED
    with_memory = [batch for batch in written if batch.memory is not None]
    assert len(with_memory) == 1
    assert "replies" in (with_memory[0].state or "")
    assert [row.table for row in with_memory[0].rows] == ["answers"]


def test_the_frame_of_a_call_follows_its_state_under_the_id_that_the_state_names(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit, written = rig.journal.commit, list[Batch]()

    def note(batch: Batch) -> None:
        written.append(batch)
        commit(batch)

    monkeypatch.setattr(rig.journal, "commit", note)
    while rig.state[1] == 0:
        rig.see(0.1, "drum")
    rig.see(0.2, "drum")
    (state, *_) = [batch.state for batch in written if batch.state is not None and '"call": {' in batch.state]
    ((frame_id, _),) = [batch.frame for batch in written if batch.frame is not None]
    assert f'"frame_id": {frame_id}' in state


def test_an_acknowledgement_leaves_after_its_commit_and_the_loop_goes_on_meanwhile(held: Rig) -> None:
    held.disk_hangs = True
    held.word(1, "drum", 1.0, GO)
    held.see(1.5, "drum")
    assert held.acks == []
    assert held.stage.mode == HOLD
    held.disk_hangs = False
    held.see(0.2, "drum")
    assert [ack.result for ack in held.acks] == [Result.APPLIED]
    assert held.stage.mode == HOLD, "frames judged before that let nobody drive on"
    held.see(1.0, "drum")
    assert held.stage.mode == AUTO


@pytest.mark.parametrize("words", [(), (SetWord("drum", 1.0),)], ids=["go alone", "with a word"])
def test_after_two_seconds_without_a_commit_it_is_applied_and_not_remembered(
    held: Rig, words: tuple[SetWord, ...]
) -> None:
    held.disk_hangs = True
    heard_at = held.clock.now
    held.answer(1, GO, *words)
    while not held.acks:
        held.see(0.1, "drum")
    assert held.clock.now - heard_at == pytest.approx(2.0, abs=0.35), "it waits for its turn on the wire"
    assert held.acks[-1].result is Result.APPLIED_NOT_REMEMBERED
    held.see(1.0, "drum")
    assert held.stage.mode == AUTO, "a dead disk does not hold it for ever"


def test_a_go_that_was_acknowledged_on_a_slow_disk_lets_the_rover_drive_on(held: Rig) -> None:
    held.disk_hangs = True
    held.answer(1, GO)
    held.see(1.1)
    held.disk_hangs = False
    held.see(2.0)
    assert held.acks[-1].result is Result.APPLIED
    assert held.stage.mode == AUTO
    assert not any("too old" in text for text in held.texts)


def test_stay_needs_no_disk_to_count_and_takes_back_a_go_that_waits_for_it(held: Rig) -> None:
    held.disk_hangs = True
    held.answer(1, GO)
    held.see(0.5)
    held.answer(1, Motion.STAY, transaction=8)
    held.see(0.5)
    held.disk_hangs = False
    held.see(3.0)
    assert held.stage.mode == HOLD
    first, second = held.acks
    assert (first.transaction, first.text) == (7, "C1 go taken back by a later answer")
    assert (second.transaction, second.text) == (8, "C1 noted: still open")


@pytest.mark.parametrize("thing", ["drum", "rock"], ids=["call", "hold"])
def test_stay_with_a_word_counts_at_once_though_vision_hangs(rig: Rig, thing: str) -> None:
    rig.see(3.0, thing)
    rig.answer(1, GO)
    rig.see(0.3)
    given = [rig.calls.go_at is not None]
    rig.hung = True
    rig.answer(1, Motion.STAY, SetWord("drum", -1.0), transaction=8)
    rig.wait(0.1)
    given.append(rig.calls.go_at is not None)
    assert given == [True, False]
    assert not rig.calls.reason_filter.things


def test_a_go_that_teaches_nothing_moves_nothing_before_it_is_kept_either(rig: Rig) -> None:
    rig.see(3.0, "rock")
    assert rig.state == ("BLOCKED", 1)
    rig.disk_hangs = True
    rig.answer(1, GO)
    rig.see(1.5)
    assert (rig.acks, rig.stage.mode) == ([], HOLD)
    rig.disk_hangs = False
    rig.see(0.3)
    assert [ack.result for ack in rig.acks] == [Result.APPLIED]
    assert rig.stage.mode == HOLD, "five OK frames after it counts"
    rig.see(0.7)
    assert rig.stage.mode == AUTO


def test_a_second_go_that_waits_for_the_disk_does_not_stop_what_the_first_one_moves(rig: Rig) -> None:
    rig.see(3.0, "rock")
    assert rig.state == ("BLOCKED", 1)
    rig.answer(1, GO)
    rig.see(0.3)
    rig.disk_hangs = True
    rig.answer(1, GO, transaction=8)
    rig.see(1.3)
    assert rig.stage.mode == AUTO


@pytest.mark.parametrize("motion", [GO, Motion.STAY])
def test_who_says_go_faster_than_the_disk_writes_waits_no_longer_than_who_says_it_once(
    rig: Rig, motion: Motion
) -> None:
    rig.see(3.0, "rock")
    assert rig.state == ("BLOCKED", 1)
    rig.disk_hangs = True
    for number in range(8):
        rig.answer(1, GO if number % 2 == 0 else motion, transaction=20 + number)
        rig.see(0.6)
    assert (rig.stage.mode == AUTO) is (motion is GO), "a stay in between takes back what was said before"


def test_a_go_for_what_a_human_ended_before_it_was_kept_is_told_so(held: Rig) -> None:
    held.disk_hangs = True
    held.answer(1, GO)
    held.see(0.3)
    held.stage.mode = MANUAL
    held.see(1.2)
    held.disk_hangs = False
    held.see(0.3)
    assert held.acks[-1].text == "1 is closed: the go came too late"
    assert held.stage.mode == MANUAL


def test_a_hold_is_decided_and_commanded_while_the_disk_hangs(rig: Rig) -> None:
    rig.disk_hangs = True
    rig.see(0.6, "drum")
    assert rig.stage.mode == HOLD
    assert rig.state == ("CALLING", 1)


def test_frames_under_a_memory_that_is_not_kept_do_not_let_the_rover_drive_on(held: Rig) -> None:
    held.answer(1, GO)
    held.see(0.2)
    held.disk_hangs = True
    held.set("AT_W_DRUM", 0.5)
    held.see(1.5)
    assert held.stage.mode == HOLD
    held.see(2.0)
    assert held.stage.mode == AUTO, "after 2 s they count, remembered or not"


def test_an_id_told_before_it_was_kept_is_not_given_again(rig: Rig) -> None:
    rig.disk_hangs = True
    rig.see(3.0, "drum")
    assert rig.state == ("CALLING", 1)
    rig.restart()
    rig.disk_hangs = False
    rig.see(3.0, "drum")
    assert rig.state[0] == "CALLING"
    assert rig.state[1] > 1


def test_of_more_answers_than_there_is_room_for_all_that_wait_are_not_remembered(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.storage.writer.MAX_ROWS", 3)
    monkeypatch.setattr("companion.storage.batch.MAX_ROWS", 3)
    held.disk_hangs = True
    for number in range(5):
        held.answer(1, Motion.STAY, transaction=10 + number)
        held.see(0.1, "drum")
    held.disk_hangs = False
    held.see(0.5, "drum")
    results = [ack.result for ack in held.acks]
    assert results == [Result.APPLIED_NOT_REMEMBERED] * 4 + [Result.APPLIED]
    assert held.writer.dropped["journal"] == 2


def test_a_setting_is_echoed_once_it_is_kept(rig: Rig) -> None:
    rig.disk_hangs = True
    rig.set("AT_THR_ROI", 0.4)
    rig.set("AT_W_DRUM", -1.0)
    rig.see(1.0)
    assert rig.calls.numbers.judging.thresholds.roi == 0.4
    assert (rig.echoes("AT_THR_ROI"), rig.echoes("AT_W_DRUM")) == ([], [])
    rig.disk_hangs = False
    rig.see(0.5)
    assert (rig.echoes("AT_THR_ROI"), rig.echoes("AT_W_DRUM")) == ([0.4], [-1.0])


def test_policy_parameters_and_words_that_the_disk_did_not_take_say_so(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.see(1.0)
    rig.set("AT_POLICY", Policy.REPORT)
    rig.set("AT_THR_ROI", 0.4)
    rig.see(1.0)
    assert not [text for text in rig.texts if "ot remembered" in text]
    spoil(rig, monkeypatch)
    rig.set("AT_THR_ROI", 0.5)
    rig.see(1.0)
    rig.set("AT_POLICY", Policy.SHADOW)
    rig.see(1.0)
    rig.set("AT_W_DRUM", -1.0)
    rig.see(1.0)
    assert (rig.echoes("AT_THR_ROI")[-1], rig.echoes("AT_POLICY")[-1]) == (0.5, Policy.SHADOW)
    told = [text for text in rig.texts if text.startswith("not remembered (disk?): ")]
    assert told == [
        "not remembered (disk?): AT_THR_ROI = 0.5",
        "not remembered (disk?): policy shadow",
        "not remembered (disk?): AT_W_DRUM",
    ]


_DOINGS = st.lists(
    st.tuples(
        st.booleans(),
        st.sampled_from([None, None, GO, GO, Motion.STAY, Motion.NONE]),
        st.booleans(),
        st.integers(1, 12),
    ),
    max_size=8,
)
"""Whether the disk hangs, what is answered, whether with a word, and tenths of a second until the next."""


@settings(max_examples=15, deadline=None)
@given(_DOINGS)
def test_whatever_the_disk_does_nothing_is_acknowledged_unkept_and_nobody_drives_on_unacknowledged(
    tmp_path_factory: pytest.TempPathFactory, doings: list[tuple[bool, Motion | None, bool, int]]
) -> None:
    with virtual_time() as clock:
        rig = Rig(tmp_path_factory.mktemp("rover"), clock)
        rig.see(4.0, "drum")
        assert rig.stage.mode == HOLD
        asked: dict[int, tuple[Motion, float]] = {}
        checked = 0
        for number, (hangs, motion, with_word, tenths) in enumerate([*doings, (False, None, False, 25)]):
            rig.disk_hangs = hangs
            if motion is not None and rig.stage.mode == HOLD:
                asked[100 + number] = motion, clock.now
                words = (SetWord("drum", 1.0),) if with_word else ()
                rig.answer(1, motion, *words, transaction=100 + number)
            for _ in range(tenths):
                rig.see(0.1, "drum")
                kept = {row[2] for row in (rig.journal.load_supervision() or {})["replies"]}
                for ack in rig.acks[checked:]:
                    assert ack.transaction in kept or ack.result not in (Result.APPLIED, Result.NOT_COVERED)
                    assert clock.now - asked[ack.transaction][1] <= 2.3
                checked = len(rig.acks)
                if rig.stage.mode == AUTO:
                    acknowledged = {ack.transaction for ack in rig.acks}
                    assert any(asked[one][0] is GO for one in acknowledged)
        assert {ack.transaction for ack in rig.acks} == set(asked)
        newest = [motion for motion, _ in asked.values()]
        if newest and newest[-1] is GO:
            assert rig.stage.mode == AUTO
        if GO not in newest:
            assert rig.stage.mode == HOLD
        rig.kill()


def test_words_of_a_change_that_vision_did_not_report_are_not_told(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = rig.vision._take_report

    def torn(report: object, now: float) -> list[VisionResult]:
        results = take(report, now)
        if isinstance(report, Done):
            raise BadReportError("torn after its change of the memory")
        return results

    monkeypatch.setattr(rig.vision, "_take_report", torn)
    rig.word(0, "drum", 1.0)
    rig.wait(1.0)
    assert rig.vision.words["drum"] == 1.0
    assert 1.0 not in rig.echoes("AT_W_DRUM"), "they are not on disk"
    rig.see(2.0)
    assert rig.echoes("AT_W_DRUM")[-1] == 1.0
    assert "drum: 1" in rig.daemon.status.figures()["words"]
