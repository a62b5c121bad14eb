"""Vision holds the frame of the open call and of the hold for an answer, or another takes its place."""

from __future__ import annotations

import pytest

from anytraverse.frame import Frame
from anytraverse.operations import Tap
from companion.vision.worker import RECENT
from companion.wire.ids import Motion, Result
from tests.companion.daemon.rig import AUTO, HOLD, PERIOD, Rig, picture

BOX = (0.4, 0.65, 0.6, 0.9)


def judged(rig: Rig, thing: str) -> None:
    """A frame is judged; the supervisor has not heard of it, nor vision of what it asks for."""
    rig.clock.now += PERIOD
    rig.frame_id += 1
    rig.child.judge(
        Frame(rig.frame_id, rig.clock.now - rig.latency, picture(thing, scene=rig.frame_id % 256))
    )


def until_open(rig: Rig, thing: str = "drum") -> None:
    """The call is opened, and nothing was drawn for it yet."""
    while rig.calls.call is None:
        judged(rig, thing)
        rig.turn()


def answered(rig: Rig) -> None:
    """A word and a go end the call."""
    rig.see(3.0, "drum")
    assert rig.stage.mode == HOLD
    assert rig.state == ("CALLING", 1)
    rig.word(1, "drum", 0.5, Motion.GO)
    rig.see(2.0, "drum")
    assert [ack.result for ack in rig.acks] == [Result.APPLIED]
    assert rig.stage.mode == AUTO


def test_a_call_that_the_last_report_of_a_dying_vision_opens_can_be_answered(rig: Rig) -> None:
    judged(rig, "drum")
    rig.turn()
    judged(rig, "drum")
    rig.child.death = "SIGSEGV"
    assert rig.calls.last_id == 0
    rig.turn()
    assert rig.calls.last_id == 1
    answered(rig)


def test_a_call_that_is_opened_while_vision_is_away_can_be_answered(rig: Rig) -> None:
    until_open(rig)
    rig.child.death = "SIGSEGV"
    rig.turn()
    answered(rig)


def test_a_call_whose_frame_vision_had_let_go_before_it_was_asked_to_keep_it_can_be_answered(
    rig: Rig,
) -> None:
    until_open(rig)
    for _ in range(RECENT):
        judged(rig, "drum")
    answered(rig)


def test_a_call_whose_frame_a_new_vision_cannot_judge_can_be_answered(
    held: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    held.child.death = "SIGSEGV"
    with monkeypatch.context() as patched:
        patched.setattr(held.perceiver, "encode", lambda _: 1 / 0)
        held.wait(0.3)
    answered(held)


@pytest.mark.slow
def test_the_frame_of_a_restored_call_outlives_a_vision_that_dies_over_it(held: Rig) -> None:
    asked = held.calls.call
    assert asked is not None
    held.restart()
    held.child.death = "SIGSEGV"
    held.see(1.0, "drum")
    call = held.calls.call
    assert call is not None
    assert call.seen is not None
    assert call.seen.frame.id == call.frame_id == asked.frame_id
    answered(held)


def test_a_call_opened_while_more_is_drawn_than_can_be_can_be_answered(rig: Rig) -> None:
    for number in range(20):
        rig.vision.draw(1, f"picture {number}", rig.calls.state(rig.clock.now))
    until_open(rig)
    answered(rig)


def test_a_hold_whose_frame_died_with_vision_shows_another_that_can_be_tapped_in(rig: Rig) -> None:
    while rig.calls.hold is None or rig.calls.hold.seen is None:
        judged(rig, "rock")
        rig.turn()
    rig.child.death = "SIGSEGV"
    rig.see(2.0, "rock")
    hold = rig.calls.hold
    assert hold is not None
    assert hold.seen is not None
    rig.answer(hold.id, Motion.GO, Tap(hold.seen.frame.id, BOX, "gnome", 1.0))
    rig.see(2.0, "rock")
    assert [ack.result for ack in rig.acks] == [Result.APPLIED]


def test_the_picture_that_vision_sent_as_it_died_is_the_calls(rig: Rig) -> None:
    until_open(rig)
    call = rig.calls.call
    assert call is not None
    rig.child.work()
    rig.child.death = "SIGSEGV"
    rig.turn()
    rig.turn()
    assert rig.vision.has_stored_frame(call.frame_id)
    assert rig.journal.load_frame(call.frame_id) is not None
