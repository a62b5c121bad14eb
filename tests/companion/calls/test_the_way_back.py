"""Rule 12: what it takes to drive on, and what calls it back."""

from __future__ import annotations

from anytraverse.regions import Box
from companion.calls.decisions import GoLapsed, HoldMoved, SetMode
from companion.calls.hold import HoldEvent, HoldState
from companion.wire.ids import Motion, Outcome, Policy, Result, Stage
from tests.companion.calls.scenes import (
    AUTO,
    CLEAR,
    DRUM,
    GUIDED,
    HOLD,
    LOG,
    Scene,
    Thing,
    View,
    reported,
)


def when(scene: Scene, mode: int) -> list[float]:
    """Seconds between the commands of `mode` and the first of them."""
    times = [at for at, decision in scene.log if isinstance(decision, SetMode) and decision.mode == mode]
    return [round(at - times[0], 2) for at in times]


def stage(scene: Scene) -> HoldState:
    """Where the hold stands."""
    return scene.hold.state


def test_nothing_resumes_without_a_go(held: Scene) -> None:
    held.run(300.0, CLEAR)
    assert held.modes() == [HOLD]
    assert held.calls.stage() is Stage.CLEAR


def test_a_go_is_followed_by_five_ok_frames_before_the_rover_drives(held: Scene) -> None:
    held.run(2.0, CLEAR)
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(CLEAR, CLEAR, CLEAR, CLEAR)
    assert held.modes() == [HOLD]
    held.show(CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_a_bad_frame_between_starts_the_count_anew(held: Scene) -> None:
    held.run(2.0, CLEAR)
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(CLEAR, CLEAR, CLEAR, CLEAR, LOG, CLEAR, CLEAR, CLEAR, CLEAR)
    assert held.modes() == [HOLD]
    held.show(CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_a_black_out_between_starts_the_count_anew(held: Scene) -> None:
    held.run(2.0, CLEAR)
    held.go()
    held.show(CLEAR, CLEAR, CLEAR, CLEAR)
    held.camera = False
    held.run(3.0)
    held.show(CLEAR, CLEAR, CLEAR, CLEAR)
    assert held.modes() == [HOLD]
    held.show(CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_a_second_go_does_not_start_the_count_anew(held: Scene) -> None:
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM)
    held.go()
    held.show(DRUM, DRUM)
    assert held.modes() == [HOLD, AUTO]


def test_resuming_goes_back_to_the_mode_before_and_closes_the_call(held: Scene) -> None:
    held.go()
    held.run(1.5, DRUM)
    assert held.autopilot.mode == AUTO
    assert held.events() == [HoldEvent.CONFIRMED, HoldEvent.RESUMED]
    assert held.closed() == [(1, Outcome.ACCEPTED)]
    assert held.calls.hold is None


def test_guided_is_given_back_as_guided() -> None:
    scene = Scene(Policy.HOLD, mode=GUIDED)
    scene.run(1.0)
    scene.run(1.0, LOG)
    scene.go()
    scene.run(1.5, CLEAR)
    assert scene.modes() == [HOLD, GUIDED]
    [resumed] = [moved for moved in scene.all(HoldMoved) if moved.event is HoldEvent.RESUMED]
    assert resumed.hold.mode_before == GUIDED


def test_the_way_back_is_tried_three_times_then_failed_and_needs_another_go(held: Scene) -> None:
    held.autopilot.deaf = True
    held.go()
    held.run(20.0, DRUM)
    assert when(held, AUTO) == [0.0, 1.0, 2.0]
    [failed] = [moved for moved in held.all(HoldMoved) if moved.event is HoldEvent.FAILED]
    assert failed.resuming
    assert held.calls.go_at is None
    assert stage(held) is HoldState.STANDING
    assert held.autopilot.mode == HOLD


def test_a_revoked_go_that_the_disk_has_at_last_does_not_confirm_a_later_one(held: Scene) -> None:
    held.run(2.0, CLEAR)
    first = held.now
    held.keep(held.calls.apply_answer(1, Motion.GO, (), None, now=first, go_at=first)[1])
    held.run(0.2, CLEAR)
    held.answer(Motion.STAY)
    held.run(0.2, CLEAR)
    second = held.now
    held.keep(held.calls.apply_answer(1, Motion.GO, (), None, now=second, go_at=second)[1])
    held.keep(held.calls.confirm_go(first, held.now))
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD], "the second go is not in the journal yet"
    held.keep(held.calls.confirm_go(second, held.now))
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_a_go_lapses_after_sixty_seconds_of_not_ok(blocked: Scene) -> None:
    assert blocked.go() is Result.APPLIED
    blocked.run(59.0)
    assert blocked.all(GoLapsed) == []
    blocked.run(2.0)
    assert blocked.all(GoLapsed) == [GoLapsed(1)]
    blocked.run(5.0, CLEAR)
    assert blocked.autopilot.mode == HOLD
    assert blocked.calls.stage() is Stage.CLEAR


def test_a_go_lapses_after_sixty_seconds_without_a_frame(held: Scene) -> None:
    held.go()
    held.camera = False
    held.run(61.0)
    assert held.all(GoLapsed) == [GoLapsed(1)]


def test_a_go_given_less_than_sixty_seconds_before_the_last_bad_frame_counts(blocked: Scene) -> None:
    blocked.go()
    blocked.run(59.8)
    blocked.run(1.5, CLEAR)
    assert blocked.autopilot.mode == AUTO


def test_a_go_on_a_blocked_way_does_not_drive_over_it(blocked: Scene) -> None:
    blocked.go()
    blocked.run(30.0)
    assert blocked.modes() == [HOLD]
    assert not blocked.calls.reason_filter.things


def test_a_way_that_is_open_by_less_than_the_margin_is_not_driven_yet(blocked: Scene) -> None:
    narrow = View((Thing(Box(20 / 60, 34 / 40, 22 / 60, 37 / 40), "log"),))
    blocked.run(2.0, narrow)
    assert blocked.calls.stage() is Stage.OPEN
    blocked.go()
    blocked.run(10.0, narrow)
    assert blocked.calls.reason_filter.ok_run > 50
    assert blocked.modes() == [HOLD]
    blocked.run(1.5, CLEAR)
    assert blocked.autopilot.mode == AUTO


def test_a_go_that_was_fulfilled_is_not_for_the_next_hold(blocked: Scene) -> None:
    blocked.go()
    blocked.run(2.0, CLEAR)
    blocked.run(1.0, LOG)
    blocked.run(10.0, CLEAR)
    assert blocked.autopilot.mode == HOLD


def test_a_go_to_a_call_that_held_nothing_is_not_for_the_next_hold(report: Scene) -> None:
    report.run(1.0, DRUM)
    report.go()
    report.policy(Policy.HOLD)
    report.run(1.0, LOG)
    report.run(10.0, CLEAR)
    assert report.modes() == [HOLD]


def test_disarming_ends_the_go_and_arming_does_not_drive_off(blocked: Scene) -> None:
    blocked.go()
    blocked.human(HOLD, armed=False)
    assert blocked.all(GoLapsed) == [GoLapsed(1)]
    blocked.run(20.0, CLEAR)
    blocked.human(HOLD, armed=True)
    blocked.run(20.0, CLEAR)
    assert blocked.modes() == [HOLD]


def test_a_go_while_disarmed_is_none(blocked: Scene) -> None:
    blocked.human(HOLD, armed=False)
    blocked.go()
    blocked.run(5.0, CLEAR)
    blocked.human(HOLD, armed=True)
    blocked.run(5.0, CLEAR)
    assert blocked.modes() == [HOLD]


def test_disarming_on_the_way_back_commands_nothing_more(held: Scene) -> None:
    held.autopilot.deaf = True
    held.go()
    held.run(0.6, DRUM)
    assert held.modes() == [HOLD, AUTO]
    held.human(HOLD, armed=False)
    held.run(20.0, DRUM)
    assert held.modes() == [HOLD, AUTO]


def test_nothing_is_resumed_over_an_autopilot_that_fell_silent(blocked: Scene) -> None:
    blocked.autopilot.silent = True
    blocked.run(6.0)
    blocked.go()
    blocked.run(5.0, CLEAR)
    assert blocked.modes() == [HOLD]
    assert blocked.all(GoLapsed) == [GoLapsed(1)]


def test_a_bad_frame_calls_the_way_back_back(held: Scene) -> None:
    held.autopilot.delay = 0.5
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM)
    assert stage(held) is HoldState.RESUMING
    held.show(LOG)
    assert held.modes() == [HOLD, AUTO, HOLD]
    held.run(3.0, LOG)
    assert held.autopilot.mode == HOLD
    assert HoldEvent.TAKEN_OVER not in held.events()
    assert stage(held) is HoldState.STANDING


def test_frames_that_stop_on_the_way_back_call_it_back(held: Scene) -> None:
    held.autopilot.deaf = True
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM)
    held.camera = False
    held.run(1.2)
    assert held.modes()[-1] == HOLD


def test_stay_calls_the_way_back_back(held: Scene) -> None:
    held.autopilot.delay = 0.5
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM)
    held.answer(Motion.STAY)
    assert held.modes() == [HOLD, AUTO, HOLD]
    held.run(3.0, DRUM)
    assert held.autopilot.mode == HOLD


def test_a_way_back_that_shows_late_is_ours_and_is_held_again(held: Scene) -> None:
    held.autopilot.deaf, held.autopilot.delay = True, 0.2
    held.go()
    held.run(0.3, DRUM)
    held.hear()
    held.run(0.4, DRUM)
    held.show(LOG)
    assert held.modes() == [HOLD, AUTO, HOLD]
    held.hear()  # an old heartbeat: still in hold
    assert stage(held) is HoldState.REQUESTED
    held.autopilot.mode = AUTO  # only now the first command shows
    held.hear()
    assert held.calls.hold is not None
    held.run(1.1, LOG)
    assert held.modes() == [HOLD, AUTO, HOLD, HOLD]


def test_the_mode_before_shown_long_after_a_call_back_is_a_humans(held: Scene) -> None:
    held.autopilot.delay = 0.3
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM, LOG)
    held.run(5.0, LOG)
    assert stage(held) is HoldState.STANDING
    held.human(AUTO)
    assert held.events()[-1] is HoldEvent.TAKEN_OVER


def test_a_position_alone_confirms_no_hold(held: Scene) -> None:
    held.autopilot.deaf = True
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM, LOG)
    heard = held.calls.monitor.newest.reported_at
    held.keep(held.calls.vehicle_reported(reported(HOLD, heard), held.now + 0.01))
    assert stage(held) is HoldState.REQUESTED


def test_a_resume_that_was_called_back_needs_no_second_go(held: Scene) -> None:
    held.autopilot.delay = 0.3
    held.autopilot.compares = True
    held.hear()
    held.go()
    held.show(DRUM, DRUM, DRUM, DRUM, DRUM, LOG)
    held.run(3.0, DRUM)
    assert held.autopilot.mode == AUTO


def test_a_hold_that_never_took_is_given_up_when_the_view_is_clear_and_go_was_said(hold: Scene) -> None:
    hold.autopilot.deaf = True
    hold.run(5.0, LOG)
    hold.go()
    hold.run(3.0, CLEAR)
    assert hold.calls.hold is None
    assert AUTO not in hold.modes()
    assert hold.events() == [HoldEvent.FAILED, HoldEvent.RESUMED]


def test_the_old_go_does_not_count_for_a_new_call(blocked: Scene) -> None:
    blocked.go()
    blocked.run(2.0, DRUM)
    assert blocked.calls.go_at is None
    blocked.run(10.0, CLEAR)
    assert blocked.autopilot.mode == HOLD


def test_only_our_own_hold_is_undone() -> None:
    scene = Scene(Policy.HOLD, mode=HOLD)
    scene.run(1.0, DRUM)
    scene.go()
    scene.run(5.0, CLEAR)
    assert scene.modes() == []
    assert scene.closed() == [(1, Outcome.ACCEPTED)]
