"""Rules 5 and 7: changes and motion, words that cover and words that do not, stale answers."""

from __future__ import annotations

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Reason
from anytraverse.operations import SetWord
from anytraverse.regions import Box
from companion.calls.decisions import CallState
from companion.wire.ids import Kind, Motion, Outcome, Result, Stage, State
from tests.companion.calls.scenes import (
    ACROSS,
    AHEAD,
    AUTO,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    HOLD,
    Scene,
    Thing,
    View,
)

DRIVABLE = {"drum": 1.0}
FORBIDDEN = {"drum": -1.0}
BESIDE_THE_POINT = {"puddle": -1.0}
BARREL = View((Thing(ACROSS),))
"""A drum right across the way."""


def test_an_answer_to_an_id_that_is_not_open_is_stale(held: Scene) -> None:
    assert held.answer(Motion.GO, target=7) is Result.STALE
    assert held.calls.resolve(7, held.now) is None
    assert held.calls.go_at is None


def test_an_answer_to_a_closed_call_is_stale(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.go()
    assert report.answer(Motion.GO, target=1) is Result.STALE


def test_without_anything_open_zero_means_nothing(report: Scene) -> None:
    assert report.calls.resolve(0, report.now) is None
    assert report.answer(Motion.GO, target=0) is Result.STALE


def test_zero_means_the_current_one_only_when_it_was_announced_two_seconds_ago(report: Scene) -> None:
    report.show(DRUM, DRUM)
    assert report.calls.resolve(0, report.now + 1.9) is None
    assert report.calls.resolve(0, report.now + 2.0) == 1
    assert report.calls.resolve(1, report.now) == 1


def test_zero_means_a_hold_without_a_call_too(blocked: Scene) -> None:
    assert blocked.calls.kind is Kind.HOLD
    assert blocked.calls.resolve(0, blocked.now + 2.0) == blocked.hold.id == 1


def test_zero_does_not_mean_a_call_that_has_just_taken_the_place_of_another(held: Scene) -> None:
    held.run(3.0)
    held.answer(words=DRIVABLE)
    held.run(0.3, View((Thing(BESIDE, "tent"),)))
    assert held.calls.current_id == 2
    assert held.calls.resolve(0, held.now) is None


def test_words_that_cover_the_thing_close_a_call_that_holds_nothing(report: Scene) -> None:
    report.run(1.0, DRUM)
    assert report.answer(words=DRIVABLE) is Result.APPLIED
    assert report.closed() == [(1, Outcome.ANSWERED)]
    report.run(5.0, DRUM)
    assert report.opened() == [1]


def test_words_that_do_not_cover_the_thing_leave_the_call_open(report: Scene) -> None:
    report.run(1.0, DRUM)
    assert report.answer(words=BESIDE_THE_POINT) is Result.NOT_COVERED
    assert report.closed() == []
    assert report.call.state is CallState.NOT_COVERED
    assert report.calls.stage() is Stage.OPEN
    assert report.answer(words=DRIVABLE) is Result.APPLIED
    assert report.closed() == [(1, Outcome.ANSWERED)]


def test_words_that_do_not_cover_the_thing_take_their_go_with_them(held: Scene) -> None:
    assert held.go(BESIDE_THE_POINT) is Result.NOT_COVERED
    assert held.calls.go_at is None
    held.run(10.0, CLEAR)
    assert held.autopilot.mode == HOLD
    assert held.calls.stage() is Stage.CLEAR


def test_a_later_word_without_go_does_not_use_the_go_of_words_that_did_not_cover(held: Scene) -> None:
    held.go(BESIDE_THE_POINT)
    assert held.answer(words=DRIVABLE) is Result.APPLIED
    held.run(10.0, DRUM)
    assert held.autopilot.mode == HOLD


def test_a_revoked_go_leaves_the_call_open_and_forgets_words_that_did_not_cover_it(
    held: Scene,
) -> None:
    held.answer(words=BESIDE_THE_POINT)
    held.go()
    accepted = held.call.state
    held.answer(Motion.STAY)
    assert (accepted, held.call.state) == (CallState.ACCEPTED, CallState.OPEN)
    assert not held.calls.reason_filter.things
    held.run(5.0, DRUM)
    assert (held.modes(), held.closed()) == ([HOLD], [])


def test_words_with_go_resume_after_five_ok_frames(held: Scene) -> None:
    held.go(DRIVABLE)
    assert held.calls.stage() is Stage.ANSWERED
    held.run(1.5, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.closed() == [(1, Outcome.ANSWERED)]
    assert not held.calls.reason_filter.things


def test_after_words_without_go_the_hold_stands_and_asks_clear_now_go(held: Scene) -> None:
    held.answer(words=DRIVABLE)
    assert held.calls.stage() is Stage.ANSWERED
    assert held.calls.state(held.now) is State.HOLDING
    held.run(30.0, DRUM)
    assert held.modes() == [HOLD]
    assert held.calls.stage() is Stage.CLEAR
    held.go()
    held.run(1.5, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.closed() == [(1, Outcome.ANSWERED)]


def test_a_go_after_the_words_accepts_the_thing_as_a_go_with_them_does(held: Scene) -> None:
    held.answer(words=DRIVABLE)
    assert not held.calls.reason_filter.things
    held.go()
    assert held.calls.reason_filter.things.accepted == {Reason.UNKNOWN_OBJECT}


def test_go_with_words_that_forbid_the_thing_waits_until_it_is_removed(hold: Scene) -> None:
    hold.run(1.0, BARREL)
    assert hold.go(FORBIDDEN) is Result.APPLIED
    hold.run(30.0, BARREL)
    assert hold.modes() == [HOLD]
    assert hold.calls.state(hold.now) is State.BLOCKED
    hold.run(1.5, CLEAR)
    assert hold.autopilot.mode == AUTO
    assert hold.closed() == [(1, Outcome.ANSWERED)]


def test_the_newest_frame_decides_on_motion_and_may_open_a_new_call(held: Scene) -> None:
    held.run(0.5, View((Thing(AHEAD), Thing(BESIDE, "tent"))))
    assert held.go(DRIVABLE) is Result.APPLIED
    held.run(0.5)
    assert held.opened() == [1, 2]
    assert held.closed() == [(1, Outcome.ANSWERED)]
    assert held.hold.id == 2
    held.run(10.0)
    assert held.modes() == [HOLD]


def test_one_newest_frame_judged_again_does_not_open_a_call_alone(held: Scene) -> None:
    held.show(View((Thing(AHEAD), Thing(BESIDE, "tent"))))
    held.answer(words=DRIVABLE)
    held.run(2.0, DRUM)
    assert held.opened() == [1]


def test_nor_does_it_after_a_go(held: Scene) -> None:
    held.show(View((Thing(AHEAD), Thing(BESIDE, "tent"))))
    held.go()
    held.run(2.0, DRUM)
    assert held.opened() == [1]
    assert held.autopilot.mode == AUTO


def test_a_bad_frame_and_the_same_frame_judged_again_open_no_call(blocked: Scene) -> None:
    blocked.show(View((Thing(ACROSS, "log"), Thing(Box(0.44, 0.87, 0.56, 0.95), "tent"))))
    blocked.answer(words=BESIDE_THE_POINT)
    assert blocked.opened() == []
    blocked.show(View((Thing(ACROSS, "log"), Thing(Box(0.44, 0.87, 0.56, 0.95), "tent"))))
    assert blocked.opened() == [2]


def test_an_answer_to_frames_that_are_no_longer_fresh_is_no_sight(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.camera = False
    report.run(0.9)
    report.answer(words=DRIVABLE)
    report.run(0.3)
    assert Reason.FAULT in report.calls.reason_filter.reasons(report.now)


def test_what_cannot_be_judged_again_is_not_covered(held: Scene) -> None:
    held.frames[held.call.frame_id] = BROKEN
    assert held.answer(words=DRIVABLE) is Result.NOT_COVERED


def test_a_place_that_cannot_be_compared_is_not_covered(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    report.frames[report.call.frame_id] = View(turned=float("nan"))
    assert report.answer(words=DRIVABLE) is Result.NOT_COVERED


def test_an_answered_place_is_known_even_when_the_rover_is_elsewhere_by_then(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    report.run(0.5, View(turned=120.0))
    assert report.answer(words={"sand": 1.0}) is Result.APPLIED
    assert report.reference == 0.0
    assert report.closed() == [(1, Outcome.ANSWERED)]
    report.run(0.5)
    assert report.opened() == [1, 2]


def test_a_place_that_was_not_remembered_is_not_known(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    outcome = AnswerOutcome(report.judged(report.call.frame_id), report.judged(report.frame))
    result, _ = report.calls.apply_answer(1, Motion.NONE, (SetWord("sand", 1.0),), outcome, report.now)
    assert result is Result.NOT_COVERED


def test_an_answer_of_any_kind_is_judged_with_the_words_that_were_set_meanwhile(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.words.update(DRIVABLE)
    report.answer(Motion.LOOK_AGAIN)
    assert report.closed() == [(1, Outcome.ANSWERED)]


def test_words_and_go_at_clear_now_are_a_go_though_the_words_do_not_cover_what_is_gone(held: Scene) -> None:
    held.run(2.0, CLEAR)
    assert held.calls.stage() is Stage.CLEAR
    assert held.go({"puddle": -1.0}) is Result.APPLIED
    held.run(2.0, CLEAR)
    assert held.autopilot.mode == AUTO
    assert held.closed() == [(1, Outcome.ACCEPTED)]


def test_words_and_go_before_that_wait_for_words_that_cover_the_thing(held: Scene) -> None:
    assert held.go({"puddle": -1.0}) is Result.NOT_COVERED
    held.run(2.0, CLEAR)
    assert held.autopilot.mode == HOLD


def test_words_at_clear_now_that_make_the_view_bad_hold_on(held: Scene) -> None:
    held.run(2.0, CLEAR)
    held.go({"trail": -1.0, "log": 1.0})
    held.run(3.0, CLEAR)
    assert held.autopilot.mode == HOLD
