"""A rover that stands after its mission is not held, and no resume begins the mission anew."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.calls.hold import HoldEvent, HoldState
from companion.vehicle.ardupilot import INITIALISING
from companion.vehicle.px4 import LOITER, LOITERING, MISSION
from companion.vehicle.state import Mission, MissionState
from companion.wire.ids import Motion, Policy, State
from tests.companion.calls.scenes import AUTO, BROKEN, CLEAR, DRUM, GUIDED, HOLD, Scene, View

DRIVEN = Mission(3, 5, MissionState.ACTIVE, 0, 1000.0)
COMPLETE = Mission(5, 5, MissionState.COMPLETE, 0, 1000.0)
OLD = Mission(5, None, MissionState.UNKNOWN, 0, 1000.0)
"""As firmware reports it that knows no mission states."""
OLD_AT_LAST = replace(OLD, reached=5, reached_at=999.0)


def scene(mission: Mission | None, *, stands: bool, mode: int = AUTO, policy: Policy = Policy.HOLD) -> Scene:
    """A rover in AUTO, of whose mission this is reported."""
    made = Scene(policy, mode=mode)
    made.autopilot.mission, made.autopilot.stands = mission, stands
    made.run(1.5)
    return made


def report(scene: Scene, mission: Mission) -> None:
    """The autopilot reports this of its mission."""
    scene.autopilot.mission = mission
    scene.run(1.1, CLEAR)


def reboots(scene: Scene) -> None:
    """The autopilot reboots into HOLD, and a person arms it. Of its mission it has not reported yet."""
    assert scene.autopilot.mission is not None
    scene.autopilot.mission = replace(scene.autopilot.mission, fresh=False)
    scene.human(INITIALISING, armed=False)
    scene.run(1.0, CLEAR)
    scene.human(HOLD, armed=False)
    scene.run(1.0, CLEAR)
    scene.human(HOLD)


@pytest.mark.parametrize("view", [DRUM, BROKEN])
def test_a_rover_that_stands_after_its_mission_is_not_held(view: View) -> None:
    standing = scene(COMPLETE, stands=True)
    standing.run(3.0, view)
    assert standing.modes() == []
    assert standing.calls.hold is None


def test_nor_does_its_script_hold_it_there_for_a_fault() -> None:
    standing = scene(COMPLETE, stands=True)
    assert not standing.calls.fault_accepted(standing.now)
    standing.run(3.0, BROKEN)
    assert standing.calls.state(standing.now) is State.FAULT
    assert standing.calls.fault_accepted(standing.now)
    standing.autopilot.stands = False
    standing.hear()
    assert not standing.calls.fault_accepted(standing.now)


def test_a_go_there_answers_the_call_and_commands_nothing() -> None:
    standing = scene(COMPLETE, stands=True)
    standing.run(1.0, DRUM)
    standing.go()
    standing.run(3.0, CLEAR)
    assert standing.modes() == []
    assert standing.calls.call is None


@pytest.mark.parametrize(
    ("mission", "stands"),
    [
        (COMPLETE, False),
        (replace(COMPLETE, fresh=False), True),
        (replace(COMPLETE, state=MissionState.UNKNOWN), True),
        (replace(COMPLETE, state=MissionState.ACTIVE), True),
        (OLD_AT_LAST, True),
        (None, True),
    ],
)
def test_it_counts_as_driving_unless_both_are_known(mission: Mission | None, stands: bool) -> None:
    driving = scene(mission, stands=stands)
    driving.run(1.0, DRUM)
    assert driving.modes() == [HOLD]


def test_a_rover_in_guided_counts_as_driving_whatever_its_mission() -> None:
    driving = scene(COMPLETE, stands=True, mode=GUIDED)
    driving.run(1.0, DRUM)
    assert driving.modes() == [HOLD]
    driving.go()
    driving.run(2.0, CLEAR)
    assert driving.modes() == [HOLD, GUIDED]


def test_it_is_held_again_once_it_moves() -> None:
    standing = scene(COMPLETE, stands=True)
    standing.run(1.0, DRUM)
    standing.autopilot.stands = False
    standing.run(1.1, DRUM)
    assert standing.modes() == [HOLD]


def test_a_hold_that_is_under_way_is_tried_until_it_is_confirmed() -> None:
    driving = scene(DRIVEN, stands=False)
    driving.autopilot.deaf = True
    driving.run(0.4, DRUM)
    driving.autopilot.mission, driving.autopilot.stands = COMPLETE, True
    driving.run(1.2, DRUM)
    driving.autopilot.deaf = False
    driving.run(2.0, DRUM)
    assert driving.hold.state is HoldState.STANDING
    assert HoldEvent.FAILED not in driving.events()


@pytest.mark.parametrize("mission", [OLD_AT_LAST, replace(OLD, item=6, total=5), COMPLETE])
def test_a_resume_into_a_mission_that_is_over_is_refused_once_a_go(mission: Mission) -> None:
    held = scene(mission, stands=False)
    held.run(1.0, DRUM)
    for refused in (1, 2):
        held.go()
        held.run(3.0, CLEAR)
        assert held.modes() == [HOLD]
        assert held.hold.state is HoldState.STANDING
        assert held.events().count(HoldEvent.MISSION_OVER) == refused


def test_that_hold_ends_when_a_human_sets_the_mode() -> None:
    held = scene(COMPLETE, stands=False)
    held.run(1.0, DRUM)
    held.go()
    held.run(2.0, CLEAR)
    held.human(AUTO)
    assert held.calls.hold is None
    assert held.events()[-1] is HoldEvent.TAKEN_OVER


def test_a_hold_for_a_fault_does_not_end_by_itself_there() -> None:
    held = Scene(Policy.HOLD, fault_ends_hold=True)
    held.autopilot.mission = COMPLETE
    held.run(1.5)
    held.run(2.0, BROKEN)
    held.run(4.0, CLEAR)
    assert held.modes() == [HOLD]
    assert held.events().count(HoldEvent.MISSION_OVER) == 1


def test_a_mission_that_is_complete_by_the_time_of_the_go_is_not_begun_anew() -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    report(held, COMPLETE)
    held.go()
    held.run(3.0, CLEAR)
    assert held.modes() == [HOLD]


def test_a_resume_waits_until_the_mission_is_reported_out_of_the_hold() -> None:
    held = scene(DRIVEN, stands=False)
    held.autopilot.mission = replace(DRIVEN, fresh=False)
    held.run(1.0, DRUM)
    held.go()
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD]
    report(held, replace(DRIVEN, state=MissionState.NOT_STARTED))
    assert held.modes() == [HOLD, AUTO]


def test_it_does_not_wait_for_what_is_not_reported_any_more() -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    held.autopilot.mission = replace(DRIVEN, fresh=False, state=MissionState.UNKNOWN)
    held.go()
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


@pytest.mark.parametrize(
    ("now", "moved", "replaced"),
    [
        (replace(DRIVEN, item=4), True, False),
        (replace(DRIVEN, total=7), False, True),
        (replace(DRIVEN, total=7, item=1), False, True),
        (replace(DRIVEN, id=9), False, True),
        (replace(DRIVEN, state=MissionState.NOT_STARTED), False, False),
    ],
)
def test_what_changed_in_the_hold_is_known_as_it_resumes(now: Mission, moved: bool, replaced: bool) -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    report(held, DRIVEN)
    report(held, now)
    hold = held.hold
    held.go()
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]
    assert (hold.interrupted.moved, hold.interrupted.replaced) == (moved, replaced)


@pytest.mark.parametrize("stale", [replace(DRIVEN, item=4, fresh=False), replace(COMPLETE, fresh=False)])
def test_an_old_report_in_the_hold_changes_nothing(stale: Mission) -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    report(held, DRIVEN)
    report(held, stale)
    assert not held.hold.interrupted.moved
    assert not held.hold.interrupted.ended
    assert held.hold.interrupted.now == DRIVEN


def test_an_item_that_was_reached_on_the_way_into_the_hold_was_not_set_by_anybody() -> None:
    held = scene(DRIVEN, stands=False)
    held.run(0.3, DRUM)
    report(held, replace(DRIVEN, item=4, state=MissionState.NOT_STARTED))
    assert held.hold.standing
    assert not held.hold.interrupted.moved


def test_a_mission_at_whose_end_it_was_held_goes_on_where_somebody_sets_another_item() -> None:
    held = scene(OLD_AT_LAST, stands=True)
    held.run(1.0, DRUM)
    report(held, OLD)
    report(held, replace(OLD, item=1))
    held.go()
    held.run(2.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_the_resume_is_refused_where_the_autopilot_reboots_in_the_hold_and_forgets_its_mission() -> None:
    held = scene(COMPLETE, stands=False)
    held.run(1.0, DRUM)
    report(held, COMPLETE)
    reboots(held)
    report(held, replace(COMPLETE, item=1, state=MissionState.NOT_STARTED))
    held.go()
    held.run(3.0, CLEAR)
    assert held.modes() == [HOLD]
    assert held.events()[-1] is HoldEvent.MISSION_OVER


def test_a_mission_that_a_reboot_interrupted_goes_on_after_a_go() -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    report(held, DRIVEN)
    reboots(held)
    report(held, replace(DRIVEN, item=1, state=MissionState.NOT_STARTED))
    held.go()
    held.run(3.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_a_completed_mission_goes_on_where_somebody_sets_an_item_in_the_hold() -> None:
    held = scene(COMPLETE, stands=False)
    held.run(1.0, DRUM)
    report(held, COMPLETE)
    report(held, replace(COMPLETE, item=2, state=MissionState.PAUSED))
    held.go()
    held.run(3.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]


def test_an_item_that_somebody_set_is_known_after_a_resume_that_was_cancelled() -> None:
    held = scene(DRIVEN, stands=False)
    held.run(1.0, DRUM)
    report(held, DRIVEN)
    report(held, replace(DRIVEN, item=4))
    held.autopilot.deaf = True
    held.go()
    held.run(1.2, CLEAR)
    assert held.hold.state is HoldState.RESUMING
    held.run(1.5, DRUM)
    held.autopilot.deaf = False
    held.run(3.0, DRUM)
    assert held.hold.standing
    assert held.hold.interrupted.moved


@pytest.mark.parametrize("mission", [OLD_AT_LAST, COMPLETE])
def test_the_resume_is_refused_after_a_restart_too(mission: Mission) -> None:
    held = scene(mission, stands=False)
    held.run(1.0, DRUM)
    held.autopilot.mission = None
    again = held.restarted()
    again.run(1.0, CLEAR)
    again.go()
    again.run(3.0, CLEAR)
    assert again.modes() == [HOLD]
    assert again.hold.state is HoldState.STANDING


@pytest.mark.parametrize(("reached", "at_last"), [(3, False), (4, True)])
def test_px4_counts_items_from_0(reached: int, at_last: bool) -> None:
    mission = replace(OLD, item=reached, total=5, reached=reached)
    held = Scene(Policy.HOLD, mode=MISSION, kind=LOITERING)
    held.autopilot.mission = mission
    held.run(1.5)
    held.run(1.0, DRUM)
    held.answer(Motion.GO)
    held.run(3.0, CLEAR)
    assert held.modes() == ([LOITER] if at_last else [LOITER, MISSION])
