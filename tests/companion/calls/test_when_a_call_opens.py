"""Rules 1 and 4: four reasons, n of m, hysteresis, one call at a time."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.assessment import Reason
from anytraverse.judging import Settings
from companion.calls.machine import OperatorCalls
from companion.calls.numbers import Numbers
from companion.calls.policy import PolicyState
from companion.calls.reason_filter import Debounce
from companion.wire.ids import Outcome, Policy, State
from tests.anytraverse.conftest import Rover
from tests.anytraverse.test_remembered_scenes import GRASS, MEASURED, TRAIL_TOO, entry, memory
from tests.companion.calls.scenes import (
    ACROSS,
    AHEAD,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    LOG,
    PERIOD,
    Scene,
    Thing,
    View,
)

OBJECT, PLACE = Reason.UNKNOWN_OBJECT, Reason.UNKNOWN_SCENE
UNDECIDED = View(turned=60.0, pending=True)


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


def test_a_worse_frame_is_added_to_the_record_and_stays_there(report: Scene) -> None:
    report.run(0.5, DRUM)
    seen = report.call.seen
    assert seen is not None
    assert seen.roi is not None
    assert (report.call.worst, report.call.worst_frame_id) == (seen.roi.uncertainty, report.call.frame_id)
    report.run(0.5, View((Thing(AHEAD), Thing(BESIDE))))
    worst, frame = report.call.worst, report.call.worst_frame_id
    assert worst > 0.15
    assert frame > report.call.frame_id
    report.run(0.5, View((Thing(AHEAD), Thing(BESIDE))))
    report.run(0.5, DRUM)
    assert (report.call.worst, report.call.worst_frame_id) == (worst, frame)


@given(st.lists(st.sampled_from([CLEAR, ELSEWHERE, UNDECIDED]), max_size=40))
def test_a_place_is_called_for_by_two_frames_of_three_that_show_it_unknown_or_where_none_was_ok_within_t(
    views: list[View],
) -> None:
    scene = Scene()
    scene.show(CLEAR, CLEAR)
    ok_at = scene.now - scene.latency
    for number, view in enumerate(views, 1):
        scene.now += PERIOD
        ok_at = scene.now - scene.latency if view is CLEAR else ok_at
        scene.show(view)
        known = views[max(0, number - 3) : number].count(ELSEWHERE) < 2
        assert (scene.opened() == []) == (known and scene.now - ok_at <= scene.numbers.freshness)
        if scene.opened():
            return


def test_a_thing_in_an_undecided_place_is_a_vote(report: Scene) -> None:
    report.show(*[View((Thing(AHEAD),), turned=60.0, pending=True)] * 2)
    assert report.call.reasons == {OBJECT}


def test_what_blocks_the_way_does_not_keep_an_undecided_place_from_being_called_for_after_t(
    report: Scene,
) -> None:
    report.run(0.9, View((Thing(ACROSS, "log"),), turned=60.0, pending=True))
    assert report.opened() == []
    assert report.calls.reason_filter.reasons(report.now) == {Reason.BLOCKED}
    report.run(0.4)
    assert report.call.reasons == {PLACE}


@given(
    st.lists(st.sampled_from([17, 18]), max_size=3),
    st.lists(st.sampled_from([0, 10, 16]), min_size=2, max_size=2),
)
def test_back_at_a_known_place_nobody_is_asked_though_its_first_frames_miss_the_match_by_little(
    first: list[int], then: list[int]
) -> None:
    """One of 16 remembered scenes is at 90 degrees: a match needs a cosine of .96, that of 16 degrees."""
    far = (entry(-90 - n, GRASS, order=6 + n) for n in range(15))
    rover = Rover("", Settings(thresholds=MEASURED), memory(GRASS, entry(90, TRAIL_TOO), *far))
    calls = OperatorCalls(Numbers(judging=rover.engine.settings), PolicyState(Policy.REPORT), rover.now)
    calls.assessed(rover.see(0), rover.now)
    for degrees in (*first, *then):
        seen = rover.see(90 + degrees)
        assert calls.assessed(seen, rover.now) == []
    assert seen.adopted is not None
    assert seen.ok


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
