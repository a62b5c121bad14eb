"""Rule 11 and promise 1: no OK within T holds the rover, one bad frame does not; faults and recovery."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Assessment, Reason
from companion.calls.decisions import HoldStarted
from companion.calls.hold import HoldEvent, HoldState
from companion.wire.ids import Policy, State
from tests.companion.calls.scenes import (
    AHEAD,
    AUTO,
    BROKEN,
    CLEAR,
    DRUM,
    HOLD,
    LOG,
    MANUAL,
    Scene,
    Thing,
    View,
)

FAULT = frozenset({Reason.FAULT})


def test_one_bad_frame_does_not_hold_the_rover(hold: Scene) -> None:
    hold.show(DRUM, CLEAR, CLEAR, BROKEN, CLEAR, CLEAR, LOG, CLEAR, CLEAR)
    hold.run(2.0, CLEAR)
    assert hold.held() == []
    assert hold.autopilot.mode == AUTO


def test_no_frame_at_all_from_the_start_holds_after_t() -> None:
    scene = Scene(Policy.HOLD)
    scene.camera = False
    scene.run(1.0)
    assert scene.held() == []
    scene.run(0.1)
    assert scene.held() == [FAULT]
    assert scene.calls.state(scene.now) is State.FAULT


@pytest.mark.parametrize("view", [BROKEN, DRUM, LOG])
def test_nothing_is_told_to_be_ok_before_a_frame_was(view: View) -> None:
    scene = Scene(Policy.HOLD)
    for _ in range(4):
        assert scene.calls.state(scene.now) is not State.OK
        scene.show(view)
    assert scene.calls.state(scene.now) not in {State.OK, State.STARTING}
    scene.run(3.0, CLEAR)
    scene.show(BROKEN)
    assert scene.calls.reason_filter.was_ok


def test_frames_that_stop_coming_hold_after_t(hold: Scene) -> None:
    hold.camera = False
    hold.run(0.9)
    assert hold.held() == []
    hold.run(0.5)
    assert hold.held() == [FAULT]
    assert hold.autopilot.mode == HOLD


@pytest.mark.parametrize("latency", [0.05, 0.5, 0.8])
def test_t_counts_from_the_capture_of_the_last_frame_however_late_it_was_judged(latency: float) -> None:
    scene = Scene(Policy.HOLD, latency=latency)
    scene.run(2.0)
    assert scene.calls.reason_filter.newest is not None
    captured = scene.calls.reason_filter.newest.frame.captured_at
    assert scene.held() == []
    scene.camera = False
    scene.run(2.0)
    held_at = next(at for at, decision in scene.log if isinstance(decision, HoldStarted))
    assert 1.0 < held_at - captured <= 1.1


@pytest.mark.parametrize("latency", [0.05, 0.5])
def test_t_counts_from_the_capture_of_the_last_ok_frame_while_frames_that_are_none_come(
    latency: float,
) -> None:
    scene = Scene(Policy.HOLD, latency=latency)
    scene.run(2.0)
    assert scene.calls.reason_filter.newest is not None
    captured = scene.calls.reason_filter.newest.frame.captured_at
    place = View(turned=60.0, pending=True)
    scene.run(2.0, DRUM, LOG, place, BROKEN)
    held_at = next(at for at, decision in scene.log if isinstance(decision, HoldStarted))
    assert 1.0 < held_at - captured <= 1.1


def test_a_capture_time_in_the_future_does_not_keep_a_blind_rover_driving(hold: Scene) -> None:
    hold.latency = -60.0
    hold.show(CLEAR)
    hold.camera = False
    hold.run(1.2)
    assert hold.held() == [FAULT]


def test_frames_that_waited_in_a_queue_while_we_were_stalled_are_no_fresh_views(held: Scene) -> None:
    """Each was judged in time; they are read at once, seconds later."""
    held.run(2.0, CLEAR)
    waiting = []
    for _ in range(20):
        held.now = round(held.now + 0.1, 6)
        held.frame += 1
        held.frames[held.frame] = CLEAR
        waiting.append(held.judged(held.frame))
    held.now = round(held.now + 3.0, 6)
    held.calls.monitor.forget(held.now, 5.0)
    held.now = round(held.now + 0.1, 6)
    held.hear()
    held.go()
    for seen in waiting:
        held.keep(held.calls.assessed(seen, held.now))
    assert held.calls.reason_filter.ok_run == 0
    assert held.calls.state(held.now) is State.FAULT
    assert held.modes() == [HOLD]
    held.due = held.now
    held.run(2.0, CLEAR)
    assert held.autopilot.mode == AUTO


def test_old_frames_do_not_outvote_what_blocks_the_way(blocked: Scene) -> None:
    waiting = []
    for _ in range(3):
        blocked.frame += 1
        blocked.frames[blocked.frame] = CLEAR
        waiting.append(blocked.judged(blocked.frame))
    blocked.now += 5.0
    for seen in waiting:
        blocked.keep(blocked.calls.assessed(seen, blocked.now))
    assert Reason.BLOCKED in blocked.calls.reason_filter.reasons(blocked.now)


def test_t_is_the_freshness_limit_of_the_settings() -> None:
    scene = Scene(Policy.HOLD, freshness=2.0)
    scene.run(1.0)
    scene.camera = False
    scene.run(1.9)
    assert scene.held() == []
    scene.run(0.3)
    assert scene.held() == [FAULT]


def test_frames_that_never_come_to_two_of_three_for_one_reason_hold_after_t() -> None:
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    place = View(turned=60.0, pending=True)
    scene.run(0.9, DRUM, LOG, place, BROKEN)
    assert scene.held() == []
    scene.run(0.5, DRUM, LOG, place, BROKEN)
    assert len(scene.held()) == 1
    assert scene.autopilot.mode == HOLD


def test_a_remembered_scene_that_is_never_adopted_holds_and_calls_after_t(hold: Scene) -> None:
    hold.run(1.3, View(turned=60.0, pending=True))
    assert hold.held() == [frozenset({Reason.UNKNOWN_SCENE})]
    assert hold.opened() == [1]


def test_an_assessment_without_findings_is_not_ok(hold: Scene) -> None:
    for _ in range(15):
        hold.now += 0.1
        hold.frame += 1
        hold.frames[hold.frame] = CLEAR
        seen = hold.judged(hold.frame)
        hold.keep(hold.calls.assessed(Assessment(seen.frame, seen.words, (), 0.0), hold.now))
    assert hold.held() == [FAULT]


def test_two_broken_frames_of_three_are_a_fault_at_once(hold: Scene) -> None:
    hold.show(BROKEN, CLEAR, BROKEN)
    assert hold.held() == [FAULT]


def test_an_open_call_does_not_hide_a_fault(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.camera = False
    report.run(2.0)
    assert report.calls.state(report.now) is State.FAULT


def test_the_hold_of_a_fault_waits_for_a_go_unless_the_config_lets_it_end_itself(hold: Scene) -> None:
    hold.run(1.0, BROKEN)
    hold.run(30.0, CLEAR)
    assert hold.autopilot.mode == HOLD
    hold.go()
    hold.run(1.5, CLEAR)
    assert hold.autopilot.mode == AUTO


def test_the_hold_of_a_fault_may_end_by_itself_after_five_ok_frames() -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(1.0)
    scene.run(1.0, BROKEN)
    scene.show(CLEAR, CLEAR, CLEAR, CLEAR)
    assert scene.hold.state is HoldState.STANDING
    scene.run(1.0, CLEAR)
    assert scene.autopilot.mode == AUTO
    assert scene.events() == [HoldEvent.CONFIRMED, HoldEvent.RESUMED]


def test_a_way_back_that_failed_is_told_once_and_waits_for_a_go() -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(1.0)
    scene.run(1.0, BROKEN)
    scene.autopilot.deaf = True
    scene.run(60.0, CLEAR)
    assert scene.events() == [HoldEvent.CONFIRMED, HoldEvent.FAILED]
    assert scene.modes() == [HOLD, AUTO, AUTO, AUTO]
    scene.autopilot.deaf = False
    scene.go()
    scene.run(1.0, CLEAR)
    assert scene.autopilot.mode == AUTO


def test_after_a_black_out_five_new_ok_frames_are_needed_not_one() -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(2.0)
    scene.camera = False
    scene.run(3.0)
    assert scene.calls.reason_filter.ok_run == 0
    scene.camera, scene.due = True, scene.now + 1.0
    scene.show(CLEAR, CLEAR, CLEAR, CLEAR)
    assert AUTO not in scene.modes()
    scene.run(2.0, CLEAR)
    assert scene.autopilot.mode == AUTO


def test_a_gap_that_nobody_was_awake_to_notice_counts_too(hold: Scene) -> None:
    hold.now += 5.0
    hold.show(CLEAR)
    assert hold.calls.reason_filter.ok_run == 1


@pytest.mark.parametrize("also", [DRUM, LOG])
def test_a_hold_that_was_ever_for_more_than_a_fault_does_not_end_by_itself(also: View) -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(1.0)
    scene.run(1.0, BROKEN)
    scene.run(1.0, also)
    scene.run(1.0, BROKEN)
    scene.run(20.0, CLEAR)
    assert scene.autopilot.mode == HOLD


def test_a_fault_while_a_call_is_open_does_not_make_its_hold_end_by_itself() -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True, mode=MANUAL)
    scene.run(1.0, DRUM)
    scene.run(1.0, CLEAR)
    scene.human(AUTO)
    scene.run(1.0, BROKEN)
    assert scene.hold.id == scene.call.id
    scene.run(20.0, CLEAR)
    assert scene.autopilot.mode == HOLD


def test_a_fault_hold_that_becomes_a_call_takes_the_calls_id(hold: Scene) -> None:
    hold.run(1.0, BROKEN)
    assert (hold.calls.current_id, hold.hold.id) == (1, 1)
    hold.run(1.0, View((Thing(AHEAD),)))
    assert hold.opened() == [2]
    assert hold.hold.id == 2
    assert hold.calls.resolve(1, hold.now) is None
    assert hold.modes() == [HOLD]
