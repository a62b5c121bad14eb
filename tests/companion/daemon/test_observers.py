"""Who is told of a turn cannot stop it, delay a hold or be told of what is not decided and queued yet."""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import pytest

from companion.calls.decisions import CallClosed, CallOpened, HoldStarted
from companion.daemon.answers.handler import Reply
from companion.daemon.turn import SLOW, AnswerStored, CallShown, Event, Turn
from companion.system.error_guard import FatalError
from companion.vision.client import VisionResult
from companion.vision.messages import Done, FrameJudged
from companion.wire.answers import Answer
from companion.wire.ids import Motion
from tests.companion.daemon.rig import HOLD, MakeRig, Rig

ERROR = "Companion error: see its log"


def told(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[Turn]:
    """Every turn from now on, as observers are told of it."""
    turns, see = list[Turn](), rig.daemon.observers.see

    def note(turn: Turn) -> None:
        turns.append(turn)
        see(turn)

    monkeypatch.setattr(rig.daemon.observers, "see", note)
    return turns


def kind(event: Event) -> type:
    """Of what vision reported, that of the report."""
    return type(event.report if isinstance(event, VisionResult) else event)


@pytest.mark.parametrize(
    "name", ["figures", "status_file", "records", "call_texts", "shadow", "pointing", "video_pictures"]
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


def test_a_hold_is_sent_before_the_first_observer_sees_the_turn(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders, see = list[int](), rig.daemon.observers.see

    def note(turn: Turn) -> None:
        if any(isinstance(event, HoldStarted) for event in turn.events):
            rig.stage.collect(rig.stage.now)
            orders.append(sum(message.command == 176 for message in rig.stage.sent("COMMAND_LONG")))
        see(turn)

    monkeypatch.setattr(rig.daemon.observers, "see", note)
    rig.see(1.0, "drum")
    assert orders == [1]


def test_a_hold_for_a_fault_is_too(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    orders, see = list[int](), rig.daemon.observers.see

    def note(turn: Turn) -> None:
        if any(isinstance(event, HoldStarted) for event in turn.events):
            rig.stage.collect(rig.stage.now)
            orders.append(sum(message.command == 176 for message in rig.stage.sent("COMMAND_LONG")))
        see(turn)

    monkeypatch.setattr(rig.daemon.observers, "see", note)
    rig.wait(3.0)
    assert orders == [1]


def test_what_observers_are_told_of_is_queued_for_the_disk(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    save, see = rig.persistence.save_calls, rig.daemon.observers.see

    def saved(*given: Any) -> None:
        order.append("saved" if rig.calls.call is None else "call saved")
        save(*given)

    def note(turn: Turn) -> None:
        order.append("call told" if any(isinstance(one, CallOpened) for one in turn.events) else "told")
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
    (opening,) = [turn for turn in turns if any(isinstance(one, CallOpened) for one in turn.events)]
    kinds = [kind(event) for event in opening.events]
    assert kinds.index(FrameJudged) < kinds.index(CallOpened) < kinds.index(CallShown)
    assert opening.current_id == 1
    assert opening.state.name == "CALLING"
    turns.clear()
    rig.word(1, "drum", -1.0, Motion.STAY)
    rig.see(1.0, "drum")
    events = [event for turn in turns for event in turn.events]
    kinds = [kind(event) for event in events]
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
    assert sum(isinstance(event, CallClosed) for event in events) == 1
