"""kill -9 and again: the same call, its picture, the hold, and an answer that still counts."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing

import pytest

from anytraverse.operations import Tap
from companion.wire.call_report import CallReport
from companion.wire.ids import TUNNEL_CALL, Motion, Policy, Result
from tests.anytraverse.conftest import AHEAD
from tests.companion.daemon.rig import AUTO, HOLD, WORDS, MakeRig, Rig

BOX = (AHEAD.left, AHEAD.top, AHEAD.right, AHEAD.bottom)


@pytest.mark.slow
def test_two_restarts_in_a_row_keep_id_frame_hold_and_figures(held: Rig) -> None:
    call = held.calls.call
    assert call is not None
    assert call.seen is not None
    assert call.seen.roi is not None
    uncertainty = call.seen.roi.uncertainty
    for _ in range(2):
        held.restart()
        held.see(2.0, "drum")
        again = held.calls.call
        assert again is not None
        assert (again.id, again.frame_id) == (1, call.frame_id)
        assert again.seen is not None
        assert again.seen.roi is not None
        assert again.seen.roi.uncertainty == uncertainty
        assert held.state == ("CALLING", 1)
        assert held.stage.mode == HOLD
    held.answer(1, Motion.GO, Tap(call.frame_id, BOX, "gnome", 0.5))
    held.see(3.0, "drum")
    assert held.stage.mode == AUTO


@pytest.mark.slow
def test_a_damaged_journal_is_told_and_what_can_be_read_goes_on(held: Rig) -> None:
    held.word(1, "drum", 0.5, Motion.GO)
    held.see(3.0, "drum")
    before = held.journal.load_memory()
    held.kill()
    with sqlite3.connect(held.folder / "journal.db") as connection:
        connection.execute("UPDATE supervision SET state = '[1'")
        (page,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'settled'").fetchone()
    connection.close()
    content = bytearray((held.folder / "journal.db").read_bytes())
    content[(page - 1) * 4096 : page * 4096] = bytes(4096)
    (held.folder / "journal.db").write_bytes(content)
    (held.folder / "journal.copy.db").unlink()
    held.start()
    assert before is not None
    assert held.left_out == ["journal was damaged: 2 scenes recovered, words as configured"]
    assert len(held.vision.memory.history) == len(before.history) == 2
    assert held.vision.words == WORDS
    held.see(3.0, ground="trail")
    assert held.state[1] == 2, "no id is given twice"


def test_a_call_is_told_with_a_picture_before_and_after_a_restart(make_rig: MakeRig) -> None:
    rig = make_rig(pictures=3)
    for _ in range(2):
        rig.see(3.0, "drum")
        told = [CallReport.unpack(payload) for payload in rig.stage.tunnels(TUNNEL_CALL)]
        assert told[-1].picture == "/calls/1.jpg"
        assert (rig.folder / "calls" / "1.jpg").is_file()
        rig.restart()


@pytest.mark.slow
def test_a_tap_in_a_holds_picture_of_before_a_restart_is_refused(rig: Rig) -> None:
    frames, number = [], 0
    for _ in range(2):
        rig.restart()
        rig.frame_id = (rig.journal.load_supervision() or {})["frame_id"]
        rig.see(2.0, "rock")
        hold = rig.calls.hold
        assert hold is not None
        number = number or hold.id
        assert hold.id == number
        assert hold.seen is not None
        frames.append(hold.seen.frame.id)
    for transaction, frame_id in enumerate(frames):
        rig.answer(number, Motion.GO, Tap(frame_id, BOX, "gnome", 1.0), transaction=7 + transaction)
        rig.see(0.5, "rock")
    assert [ack.result for ack in rig.acks] == [Result.REFUSED, Result.APPLIED]


@pytest.mark.slow
def test_a_picture_that_is_no_bytes_in_the_journal_is_lost_and_the_call_goes_on(held: Rig) -> None:
    held.kill()
    with closing(sqlite3.connect(held.folder / "journal.db")) as connection, connection:
        connection.execute("UPDATE frame SET png = 'torn'")
    held.start(mode=held.stage.mode)
    held.see(1.0, "gnome")
    assert "C1 picture lost: it shows the newest now" in held.texts


@pytest.mark.slow
def test_a_call_whose_picture_is_lost_asks_about_the_newest_and_says_so(held: Rig) -> None:
    held.restart(forget_frame=True)
    held.see(1.0, "gnome")
    call = held.calls.call
    assert call is not None
    assert call.id == 1
    assert call.seen is not None
    assert call.frame_id == call.seen.frame.id
    assert "C1 picture lost: it shows the newest now" in held.texts
    held.answer(1, Motion.GO, Tap(call.frame_id, BOX, "gnome", 0.5))
    held.see(3.0, "gnome")
    assert held.acks[-1].result is Result.APPLIED
    assert held.stage.mode == AUTO


@pytest.mark.slow
def test_a_picture_that_the_perceiver_fails_on_after_a_restart_counts_as_lost(held: Rig) -> None:
    held.restart()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(held.perceiver, "encode", lambda _: 1 / 0)
        held.wait(0.2)
    held.see(1.0, "drum")
    assert held.calls.call is not None
    assert held.calls.call.seen is not None
    assert "C1 picture lost: it shows the newest now" in held.texts


@pytest.mark.slow
def test_an_answer_before_the_picture_is_judged_again_is_busy(held: Rig) -> None:
    held.restart()
    held.hung = True
    held.answer(1, Motion.GO)
    held.wait(0.3)
    held.hung = False
    held.see(0.5, "drum")
    held.answer(1, Motion.GO)
    held.see(2.0, "drum")
    assert [ack.result for ack in held.acks] == [Result.BUSY, Result.APPLIED]


@pytest.mark.slow
def test_words_answered_before_a_restart_are_in_force_after_it(held: Rig) -> None:
    held.word(1, "drum", -1.0)
    held.see(1.0, "drum")
    held.restart()
    held.see(2.0, "drum")
    assert held.vision.words.format() == "grass: 1; rock: -1; drum: -1"
    assert held.state == ("BLOCKED", 1)


@pytest.mark.slow
def test_ids_rise_over_restarts(rig: Rig) -> None:
    rig.wait(2.0)
    assert rig.state[1] == 1
    rig.restart()
    rig.see(5.0, "drum")
    assert rig.state[0] == "CALLING"
    assert rig.state[1] > 1


def test_an_orderly_stop_skips_no_id(rig: Rig) -> None:
    rig.wait(2.0)
    assert rig.state[1] == 1
    rig.daemon.leave()
    rig.restart()
    rig.see(5.0, "drum")
    assert rig.state == ("CALLING", 2)


def test_the_status_file_names_what_a_person_asks_for_and_the_long_list_only_at_the_end(rig: Rig) -> None:
    path = rig.folder / "status.json"
    rig.daemon.write_status()
    rig.writer.drain()
    status = json.loads(path.read_text())
    assert set(status) == {
        "state",
        "known_place",
        "reasons",
        "current_id",
        "policy",
        "version",
        "service",
        "computer",
        "held_by",
        "mission",
        "switches",
        "shadow",
        "words",
        "set_by_ground",
        "roi_uncertainty",
        "similarity",
        "perceiver",
        "judging",
        "latency_ms",
        "test_call",
        "hold_refused",
        "guide",
        "guide_refused",
        "course",
        "px4_deadman",
        "camera",
        "vision",
        "link",
        "frames",
        "pid",
        "disk",
    }
    assert (status["state"], status["policy"], status["frames"]) == ("ok", "hold", 10)
    assert status["link"]["connections"]["main"]["mavlink"] == 2
    assert status["link"]["connections"]["main"]["sent"] == status["link"]["sent"]
    rig.daemon.leave()
    assert len(json.loads(path.read_text())["recent"]) == 10


def test_a_status_file_that_cannot_be_written_is_no_fault(rig: Rig) -> None:
    (rig.folder / "status.part").mkdir()
    rig.daemon.write_status()
    rig.see(1.0)
    assert rig.state == ("OK", 0)


def test_a_restart_in_another_policy_keeps_the_question_and_drops_the_hold(held: Rig) -> None:
    held.policy = Policy.REPORT
    held.restart()
    held.see(3.0, "drum")
    assert held.state == ("CALLING", 1)
    assert held.calls.hold is None
