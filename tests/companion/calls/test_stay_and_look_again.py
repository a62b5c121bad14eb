"""Rule 5: answers that are no words: stay, look again, and what they take back."""

from __future__ import annotations

from anytraverse.assessment import Reason
from companion.wire.ids import Motion, Outcome, Policy, Result, Stage
from tests.companion.calls.scenes import (
    AHEAD,
    AUTO,
    BROKEN,
    CLEAR,
    DRUM,
    HOLD,
    MANUAL,
    Scene,
    Thing,
    View,
)

DRIVABLE = {"drum": 1.0}
BESIDE_THE_POINT = {"puddle": -1.0}


def test_stay_leaves_call_and_hold_and_ends_only_the_escalation(held: Scene) -> None:
    assert held.answer(Motion.STAY) is Result.APPLIED
    assert held.call.quiet
    held.run(5.0)
    assert held.calls.stage() is Stage.OPEN
    assert held.closed() == []
    assert held.autopilot.mode == HOLD


def test_stay_takes_a_go_back_that_is_not_fulfilled_yet(held: Scene) -> None:
    held.go()
    held.answer(Motion.STAY)
    assert held.calls.go_at is None
    assert not held.calls.reason_filter.things
    held.run(10.0, DRUM)
    assert held.autopilot.mode == HOLD
    assert held.calls.stage() is Stage.OPEN
    assert held.opened() == [1]


def test_words_without_go_take_a_go_back_that_is_not_fulfilled_yet(held: Scene) -> None:
    held.go()
    held.answer(words=DRIVABLE)
    held.run(10.0, DRUM)
    assert held.autopilot.mode == HOLD
    assert held.calls.stage() is Stage.CLEAR


def test_words_that_uncover_an_answered_call_open_it_again(held: Scene) -> None:
    held.answer(words=DRIVABLE)
    del held.words["drum"]
    assert held.answer(words=BESIDE_THE_POINT) is Result.NOT_COVERED
    assert held.calls.stage() is Stage.OPEN


def test_look_again_forgets_what_was_seen_before(report: Scene) -> None:
    report.run(1.0, DRUM)
    between = View((Thing(AHEAD, unsure=0.23),))  # clear of the threshold, not by the margin
    report.run(1.0, between)
    assert report.calls.reason_filter.reasons(report.now) == {Reason.UNKNOWN_OBJECT}
    report.answer(Motion.LOOK_AGAIN)
    assert report.calls.reason_filter.reasons(report.now) == frozenset()
    report.run(5.5)
    assert report.closed() == [(1, Outcome.PASSED)]


def test_look_again_does_not_close_a_call_whose_thing_is_still_there(held: Scene) -> None:
    held.answer(Motion.LOOK_AGAIN)
    held.run(1.0)
    assert held.closed() == []
    assert held.calls.stage() is Stage.OPEN


def test_to_look_again_and_again_does_not_keep_the_rover_driving() -> None:
    scene = Scene(Policy.HOLD, mode=MANUAL)
    scene.run(1.0, DRUM)
    scene.autopilot.mode = AUTO
    for _ in range(20):
        scene.answer(Motion.LOOK_AGAIN)
        scene.run(0.1)
    assert scene.autopilot.mode == HOLD


def test_to_look_again_with_broken_eyes_is_no_excuse(hold: Scene) -> None:
    hold.show(BROKEN, BROKEN)
    hold.answer(Motion.LOOK_AGAIN)
    assert hold.calls.reason_filter.reasons(hold.now) == {Reason.FAULT}
    hold.show(CLEAR, CLEAR)
    assert hold.calls.reason_filter.reasons(hold.now) == set()


def test_look_again_at_a_blocked_way_resumes_nothing(blocked: Scene) -> None:
    blocked.answer(Motion.LOOK_AGAIN)
    blocked.run(10.0, CLEAR)
    assert blocked.modes() == [HOLD]


def test_words_that_make_a_blocked_way_drivable_do_not_resume_without_go(blocked: Scene) -> None:
    blocked.answer(words={"log": 1.0})
    blocked.run(10.0)
    assert blocked.modes() == [HOLD]
    assert blocked.calls.stage() is Stage.CLEAR


def test_the_same_answer_twice_does_nothing_twice(held: Scene) -> None:
    assert held.go(DRIVABLE) is Result.APPLIED
    assert held.go(DRIVABLE) is Result.APPLIED
    held.run(1.5)
    assert held.closed() == [(1, Outcome.ANSWERED)]
    assert held.modes() == [HOLD, AUTO]
    assert held.go(DRIVABLE) is Result.STALE


def test_in_hold_policy_a_call_whose_thing_walked_off_stays_and_asks_clear_now_go(held: Scene) -> None:
    held.run(60.0, CLEAR)
    assert held.closed() == []
    assert held.calls.stage() is Stage.CLEAR
    held.go()
    held.run(1.5)
    assert held.autopilot.mode == AUTO
    assert held.closed() == [(1, Outcome.ACCEPTED)]


def test_in_hold_policy_a_call_that_holds_nothing_passes() -> None:
    scene = Scene(Policy.HOLD, mode=MANUAL)
    scene.run(1.0, DRUM)
    scene.run(6.0, CLEAR)
    assert scene.closed() == [(1, Outcome.PASSED)]
