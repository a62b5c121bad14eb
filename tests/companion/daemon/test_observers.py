"""Who is told of a turn cannot stop it, delay a hold or be told of what is not decided and queued yet."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.decisions import CallClosed, CallOpened, HoldMoved, HoldStarted
from companion.daemon.answers.handler import Reply
from companion.daemon.turn import SLOW, AnswerStored, CallShown, Turn, kind_of
from companion.system.error_guard import FatalError
from companion.vision.messages import Done, FrameJudged
from companion.wire import texts
from companion.wire.answers import Answer
from companion.wire.call_report import CallReport
from companion.wire.ids import TUNNEL_CALL, Motion, Outcome, Stage
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig
from tests.companion.daemon.test_driving_where_the_camera_does_not_look import Drive, by_hand

STEERING = 3

ERROR = "Companion error: see its log"


def told(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[Turn]:
    """Every turn from now on, as observers are told of it."""
    turns, see = list[Turn](), rig.daemon.observers.see

    def note(turn: Turn) -> None:
        turns.append(turn)
        see(turn)

    monkeypatch.setattr(rig.daemon.observers, "see", note)
    return turns


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["status", "status_file", "records", "call_texts", "shadow", "pointing", "video_pictures"]
)
def test_an_observer_that_raises_stops_neither_the_turn_nor_the_others(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    rig.fails = True
    rig.daemon.recording.listeners = (1,)
    broken = getattr(rig.daemon, name)
    monkeypatch.setattr(broken, "see", lambda _turn: 1 / 0)
    rig.see(1.0, "drum")
    assert rig.state == ("CALLING", 1)
    assert rig.stage.mode == HOLD
    assert rig.texts.count(ERROR) == 1, "an operator is told, and not in every turn"
    assert [line for line in caplog.messages if line == f"{type(broken).__name__} failed"] != []
    assert b"call opened" in b"".join(one.data for one in rig.daemon.recording.take())
    rig.see(10.0)
    assert rig.texts.count(ERROR) == 2, "it goes on"


@pytest.mark.slow
def test_an_observer_that_is_slow_is_named_once_in_a_while(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    see = rig.records.see

    def slow(turn: Turn) -> None:
        rig.clock.now += 0.3
        see(turn)

    monkeypatch.setattr(rig.records, "see", slow)
    rig.see(0.5)
    lines = [line for line in caplog.messages if "longer" in line]
    assert lines == ["Records made a turn of the main loop 0.30 s longer"]
    caplog.clear()
    monkeypatch.undo()
    rig.see(11.0)
    assert not [line for line in caplog.messages if "longer" in line]


def test_one_that_takes_its_share_of_a_turn_is_not_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, rig: Rig
) -> None:
    def quick(_turn: Turn) -> None:
        rig.clock.now += 0.9 * SLOW

    monkeypatch.setattr(rig.records, "see", quick)
    rig.see(0.5)
    assert not [line for line in caplog.messages if "longer" in line]


def test_an_error_of_the_supervision_itself_is_not_survived(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_of_a_change(_turn: Turn) -> None:
        raise FatalError

    monkeypatch.setattr(rig.records, "see", half_of_a_change)
    with pytest.raises(FatalError):
        rig.step(None)


def commands_at_a_hold(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many modes were commanded when observers are first told of a hold."""
    found, see = list[int](), rig.daemon.observers.see

    def note(turn: Turn) -> None:
        if any(kind_of(event) is HoldStarted for event in turn.events):
            rig.stage.collect(rig.stage.now)
            found.append(sum(message.command == 176 for message in rig.stage.sent("COMMAND_LONG")))
        see(turn)

    monkeypatch.setattr(rig.daemon.observers, "see", note)
    return found


def test_a_hold_is_sent_before_the_first_observer_sees_the_turn(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = commands_at_a_hold(rig, monkeypatch)
    rig.see(1.0, "drum")
    assert commands == [1]


def test_a_hold_for_a_fault_is_too(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    commands = commands_at_a_hold(rig, monkeypatch)
    rig.wait(3.0)
    assert commands == [1]


def test_a_decision_that_cannot_be_told_is_carried_out(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.fails = True
    monkeypatch.setattr(rig.loop._executor, "_fault_name", lambda _now: 1 / 0)
    rig.see(1.0, "drum")
    assert rig.stage.mode == HOLD
    assert rig.calls.call is not None
    assert ERROR in rig.texts
    assert not [text for text in rig.texts if "lost" in text], "an answer may refer to its frame"


def test_what_observers_are_told_of_is_queued_for_the_disk(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    save, see = rig.persistence.save_calls, rig.daemon.observers.see

    def saved(*given: Any) -> None:
        order.append("saved" if rig.calls.call is None else "call saved")
        save(*given)

    def note(turn: Turn) -> None:
        order.append("call told" if any(kind_of(one) is CallOpened for one in turn.events) else "told")
        see(turn)

    monkeypatch.setattr(rig.persistence, "save_calls", saved)
    monkeypatch.setattr(rig.daemon.observers, "see", note)
    rig.see(1.0, "drum")
    opened = order.index("call told")
    assert order[opened - 1] == "call saved"
    assert "call saved" not in order[: opened - 1]


def test_all_are_told_the_same_which_nobody_can_change(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Turn] = []
    for observer in (rig.records, rig.daemon.call_texts, rig.daemon.recording, rig.daemon.live_picture):
        monkeypatch.setattr(observer, "see", seen.append)
    rig.step(None)
    assert len(seen) == 4 * 5
    for first in range(0, len(seen), 4):
        assert all(turn is seen[first] for turn in seen[first : first + 4])
    with pytest.raises(dataclasses.FrozenInstanceError):
        seen[0].now = 0.0  # type: ignore[misc]


def test_a_turn_tells_what_happened_in_order(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    turns = told(rig, monkeypatch)
    rig.see(1.0, "drum")
    (opening,) = [turn for turn in turns if any(kind_of(one) is CallOpened for one in turn.events)]
    kinds = [kind_of(event) for event in opening.events]
    assert kinds.index(FrameJudged) < kinds.index(CallOpened) < kinds.index(CallShown)
    assert opening.current_id == 1
    assert opening.state.name == "CALLING"
    turns.clear()
    rig.word(1, "drum", -1.0, Motion.STAY)
    rig.see(1.0, "drum")
    events = [event for turn in turns for event in turn.events]
    kinds = [kind_of(event) for event in events]
    order = [kinds.index(one) for one in (Answer, Done, AnswerStored, Reply)]
    assert order == sorted(order)
    assert kinds.count(Reply) == 1, "what is not acknowledged yet is no reply"


def test_what_happens_while_a_turn_is_told_is_told_in_the_next_one(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    rig = make_rig()
    rig.see(1.0, "drum")
    turns = told(rig, monkeypatch)
    rig.answer(1, Motion.GO)
    rig.see(3.0)
    events = [event for turn in turns for event in turn.events]
    assert len({id(event) for event in events}) == len(events), "nothing is told twice"
    assert sum(kind_of(event) is CallClosed for event in events) == 1


def test_an_error_in_one_text_costs_no_other_text_of_the_turn(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    held.fails = True
    monkeypatch.setattr(texts, "taken_over", lambda *_: 1 / 0)
    by_hand(held, MANUAL)
    held.see(3.0)
    closed = [CallReport.unpack(payload) for payload in held.stage.tunnels(TUNNEL_CALL)][-1]
    assert (closed.id, closed.stage, closed.outcome) == (1, Stage.CLOSED, Outcome.TAKEN_OVER)
    assert ERROR in held.texts


@pytest.mark.slow
def test_an_error_in_one_picture_costs_no_file_of_the_turn(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    held.fails = True
    monkeypatch.setattr(held.records, "_draw_newest", lambda *_: 1 / 0)
    held.answer(1, Motion.GO)
    held.see(6.0)
    record = json.loads((held.folder / "calls" / "1.json").read_text())
    assert record["outcome"] == "accepted"
    assert record["closed"] is not None


def test_an_alert_that_cannot_be_made_ends_the_daemon(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.calls.active_alert.current_text", lambda *_: 1 / 0)
    with pytest.raises(FatalError, match="alert"):
        rig.see(1.0, "drum")


def test_a_takeover_is_told_with_the_mode_that_took_over(held: Rig) -> None:
    held.stage.mode = MANUAL
    held.stage.heartbeat(1)
    by_hand(held, STEERING)  # both are read in one turn
    held.wait(1.0)
    assert "C1 taken over by hand: MANUAL" in held.texts


@pytest.mark.slow
def test_an_accepted_fault_is_told_by_the_name_that_it_had(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(3.0, 2.0)
    rig.stage.send(mavlink.MAVLink_mission_current_message(2, 2, 0, 0), (1, 1))
    drive.on(1.2, -2.0)
    assert rig.stage.mode == HOLD
    drive.on(3.0, 0.0)
    rig.stage.send(mavlink.MAVLink_mission_current_message(3, 2, 0, 0), (1, 1))
    drive.on(1.0, 0.0)
    by_hand(rig, AUTO)
    drive.on(2.0, 0.0)
    assert any("driven on" in text and text.endswith(": drives backwards") for text in rig.texts)


@pytest.mark.slow
@pytest.mark.parametrize("delay", range(4, 12))
def test_a_hold_that_a_call_takes_over_is_told_by_the_id_that_it_had(rig: Rig, delay: int) -> None:
    drive = Drive(rig)
    drive.on(3.0, 2.0)
    for number in range(20):
        rig.stage._heartbeat_at = math.inf  # the autopilot's comes in the turn of the judged frame
        speed = 0.0 if rig.stage.mode == HOLD else -2.0
        rig.stage.send(drive._position(speed, 0.0, 0.0), (1, 1))
        rig.see(0.1, "drum" if number >= delay else "")
        rig.stage.heartbeat(1)
    assert rig.calls.call is not None
    assert rig.calls.call.id == 2
    assert not [text for text in rig.texts if text.startswith("H2")]


def test_what_is_received_last_in_a_turn_is_told_in_it(held: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    turns = told(held, monkeypatch)
    received = held.loop._receive
    calls = list[float]()

    def receive(now: float) -> None:
        calls.append(now)
        if len(calls) > 1 and calls[-2] == now:  # the second one in a turn
            held.stage.mode = MANUAL
            held.stage.heartbeat(1)
        received(now)

    monkeypatch.setattr(held.loop, "_receive", receive)
    held.answer(1, Motion.GO)
    for _ in range(60):
        held.see(0.1)
        if held.stage.mode == MANUAL:
            break
    assert held.stage.mode == MANUAL
    over = [turn for turn in turns for one in turn.events if kind_of(one) is HoldMoved]
    assert over, "the takeover is told"
    assert not held.loop._executor.events
