"""Rules 1 and 4: four reasons, n of m, hysteresis, one call at a time."""

from __future__ import annotations

from anytraverse.assessment import Reason
from companion.calls.reason_filter import Debounce
from companion.wire.ids import Outcome, State
from tests.companion.calls.scenes import (
    AHEAD,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    LOG,
    Scene,
    Thing,
    View,
)

OBJECT, PLACE = Reason.UNKNOWN_OBJECT, Reason.UNKNOWN_SCENE


def faint(uncertainty: float) -> View:
    """A haze over everything; the mean's threshold is 0.3, its margin 0.03."""
    return View(haze=uncertainty)


def mean_only() -> Scene:
    """Reports, and judges only the mean."""
    scene = Scene(tile=None)
    scene.run(1.0)
    return scene


def test_a_thing_without_a_word_opens_a_call_at_the_second_bad_frame_of_three(report: Scene) -> None:
    report.show(DRUM)
    assert report.opened() == []
    report.show(DRUM)
    assert report.opened() == [1]
    assert report.call.reasons == {OBJECT}


def test_two_bad_frames_with_a_good_one_between_open_a_call(report: Scene) -> None:
    report.show(DRUM, CLEAR, DRUM)
    assert report.opened() == [1]


def test_two_bad_frames_of_four_open_none(report: Scene) -> None:
    report.show(DRUM, CLEAR, CLEAR, DRUM, CLEAR, CLEAR, DRUM)
    assert report.opened() == []


def test_a_changed_place_opens_a_call_for_words(report: Scene) -> None:
    report.run(0.5, ELSEWHERE)
    assert report.opened() == [1]
    assert report.call.reasons == {PLACE}


def test_what_is_known_and_not_drivable_is_never_ok_and_no_call(report: Scene) -> None:
    report.run(2.0, LOG)
    assert report.opened() == []
    assert report.calls.reason_filter.reasons(report.now) == {Reason.BLOCKED}
    assert report.calls.state(report.now) is State.BLOCKED
    assert report.calls.reason_filter.ok_run == 0


def test_broken_maps_are_a_fault_and_no_call(report: Scene) -> None:
    report.run(0.5, BROKEN)
    assert report.opened() == []
    assert report.calls.state(report.now) is State.FAULT


def test_chatter_around_the_threshold_opens_one_call_not_many() -> None:
    scene = mean_only()
    scene.run(20.0, faint(0.31), faint(0.29))
    assert scene.opened() == [1]
    assert scene.closed() == []


def test_wild_chatter_opens_one_call_not_many(report: Scene) -> None:
    report.run(20.0, DRUM, CLEAR)
    assert report.opened() == [1]
    assert report.closed() == []


def test_a_reason_ends_a_margin_on_the_good_side_of_its_threshold() -> None:
    scene = mean_only()
    scene.run(0.5, faint(0.31))
    scene.run(10.0, faint(0.29))
    assert scene.calls.reason_filter.reasons(scene.now) == {OBJECT}
    scene.run(0.5, faint(0.26))
    assert scene.calls.reason_filter.reasons(scene.now) == frozenset()


def test_similarity_has_a_margin_of_its_own(report: Scene) -> None:
    report.run(0.5, View(turned=32.0))  # cosine 0.848, threshold 0.85, margin 0.01
    report.run(1.0, View(turned=31.5))  # 0.853
    assert report.calls.reason_filter.reasons(report.now) == {PLACE}
    report.run(1.0, View(turned=30.0))  # 0.866
    assert report.calls.reason_filter.reasons(report.now) == frozenset()


def test_one_call_is_open_at_a_time_and_later_reasons_are_added(report: Scene) -> None:
    report.run(0.5, DRUM)
    report.run(0.5, View((Thing(AHEAD),), turned=60.0))
    assert report.opened() == [1]
    assert report.call.reasons == {OBJECT, PLACE}


def test_the_frame_of_a_call_is_fixed_when_it_is_announced(report: Scene) -> None:
    report.run(0.5, DRUM)
    frame, seen = report.call.frame_id, report.call.seen
    report.run(3.0, View((Thing(BESIDE),)))
    assert (report.call.frame_id, report.call.seen) == (frame, seen)
    assert seen is not None
    assert seen.frame.id == frame


def test_a_worse_frame_is_added_to_the_record(report: Scene) -> None:
    report.run(0.5, DRUM)
    assert (report.call.worst, report.call.worst_frame_id) == (
        report.call.scope and report.call.scope.uncertainty,
        report.call.frame_id,
    )
    report.run(0.5, View((Thing(AHEAD), Thing(BESIDE))))
    assert report.call.worst > 0.15
    assert report.call.worst_frame_id > report.call.frame_id


def test_a_remembered_scene_that_may_still_be_adopted_is_no_vote(report: Scene) -> None:
    report.show(*[View(turned=60.0, pending=True)] * 6)
    assert report.opened() == []


def test_a_thing_in_a_remembered_scene_that_may_still_be_adopted_is_a_vote(report: Scene) -> None:
    report.show(*[View((Thing(AHEAD),), turned=60.0, pending=True)] * 2)
    assert report.call.reasons == {OBJECT}


def test_a_call_whose_reasons_are_gone_for_five_seconds_has_passed(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.run(5.0, CLEAR)
    assert report.closed() == []
    report.run(0.5, CLEAR)
    assert report.closed() == [(1, Outcome.PASSED)]


def test_a_thing_that_comes_back_before_that_keeps_its_call(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.run(4.0, CLEAR)
    report.run(0.5, DRUM)
    report.run(4.0, CLEAR)
    assert report.closed() == []
    assert report.opened() == [1]


def test_a_call_does_not_pass_while_frames_are_missing(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.run(0.5, CLEAR)
    report.camera = False
    report.run(20.0)
    assert report.closed() == []
    report.camera = True
    report.run(4.5, CLEAR)
    assert report.closed() == []
    report.run(1.5, CLEAR)
    assert report.closed() == [(1, Outcome.PASSED)]


def test_a_call_does_not_pass_while_frames_are_broken(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.run(20.0, BROKEN)
    assert report.closed() == []


def test_after_a_call_has_passed_the_next_thing_is_a_call_of_its_own(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.run(7.0, CLEAR)
    report.run(1.0, DRUM)
    assert report.opened() == [1, 2]


def test_ids_go_from_65535_to_1(report: Scene) -> None:
    report.calls.last_id = 0xFFFF
    report.run(1.0, DRUM)
    assert report.opened() == [1]


def test_a_frame_judged_again_does_not_vote_twice() -> None:
    votes = Debounce(2, 3)
    votes.add(bad=True, clear=False)
    votes.amend(bad=True, clear=False)
    assert not votes.active
    votes.add(bad=True, clear=False)
    assert votes.active
