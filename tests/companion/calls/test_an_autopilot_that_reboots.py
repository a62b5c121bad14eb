"""An autopilot that reboots in our hold is no human who takes over: the call stays, nothing resumes alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.calls.decisions import HoldStarted, Unasked
from companion.calls.hold import HoldEvent, HoldState
from companion.vehicle import ardupilot, px4
from companion.wire.ids import Outcome, Policy, Stage
from tests.companion.calls.scenes import (
    AUTO,
    BROKEN,
    CLEAR,
    DRUM,
    GUIDED,
    HOLD,
    LOITER,
    MANUAL,
    Scene,
    View,
)

INITIALISING = ardupilot.INITIALISING


def reboot(scene: Scene, into: int, *, told: bool = True, armed: bool = False, seen: View = DRUM) -> None:
    """It falls silent, boots for some seconds, and comes back. told: a heartbeat shows that it boots."""
    scene.autopilot.silent, scene.autopilot.armed = True, False
    scene.run(4.0, seen)
    scene.autopilot.silent = False
    if told:
        scene.autopilot.mode = INITIALISING
        scene.run(1.0, seen)
    scene.autopilot.mode, scene.autopilot.armed = into, armed
    scene.run(2.0, seen)


@pytest.mark.slow
@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("into", [MANUAL, HOLD, LOITER, AUTO])
def test_the_call_and_its_hold_stay_and_nothing_is_accepted_or_commanded(
    held: Scene, into: int, told: bool
) -> None:
    reboot(held, into, told=told)
    held.run(30.0, DRUM)
    assert held.closed() == []
    assert (held.call.id, held.hold.id) == (1, 1)
    assert not held.calls.reason_filter.things
    assert held.modes() == [HOLD]
    assert held.events().count(HoldEvent.REBOOTED) == 1
    assert HoldEvent.TAKEN_OVER not in held.events()


def test_a_quick_reboot_that_only_its_mode_shows_is_one_too(held: Scene) -> None:
    held.human(INITIALISING, armed=False)
    held.human(MANUAL, armed=False)
    held.run(5.0, DRUM)
    assert held.events() == [HoldEvent.CONFIRMED, HoldEvent.REBOOTED]
    assert held.call.id == 1


def test_and_so_is_one_that_only_its_clock_shows(held: Scene) -> None:
    held.autopilot.reboots = 1
    held.human(MANUAL, armed=False)
    held.run(5.0, DRUM)
    assert held.events() == [HoldEvent.CONFIRMED, HoldEvent.REBOOTED]
    assert (held.call.id, held.calls.reason_filter.things.things) == (1, [])


def test_it_is_not_told_to_stand_because_of_us_before_it_holds_again(held: Scene) -> None:
    reboot(held, MANUAL)
    standing = [held.hold.standing]
    held.human(HOLD, armed=False)
    standing.append(held.hold.standing)
    assert standing == [False, True]
    assert held.events()[-1] is HoldEvent.CONFIRMED


@pytest.mark.parametrize("mode", [AUTO, GUIDED])
@pytest.mark.parametrize("armed", [True, False])
def test_armed_again_in_a_driving_mode_it_is_held_again(held: Scene, mode: int, armed: bool) -> None:
    """Be it by itself as it boots, or by somebody who armed it first and thought afterwards."""
    reboot(held, mode, armed=armed)
    if not armed:
        held.human(mode)
    held.run(1.0, DRUM)
    assert held.modes() == [HOLD, HOLD]
    assert held.autopilot.mode == HOLD
    assert held.call.id == 1
    held.human(mode)
    assert held.closed() == [(1, Outcome.TAKEN_OVER)], "and now it is a human's mode"


def test_armed_again_in_hold_it_stands_until_a_go_is_given(held: Scene) -> None:
    reboot(held, HOLD)
    held.human(HOLD)
    held.run(20.0, CLEAR)
    assert held.modes() == [HOLD]
    held.go()
    held.run(2.0, CLEAR)
    assert held.autopilot.mode == AUTO
    assert held.events()[-1] is HoldEvent.RESUMED


@pytest.mark.parametrize("into", [MANUAL, LOITER, AUTO])
def test_the_mode_that_the_transmitters_switch_sets_after_the_boot_is_nobodys(held: Scene, into: int) -> None:
    """It boots into HOLD, hears its transmitter a moment later, and takes the switch's mode, disarmed."""
    reboot(held, HOLD)
    held.human(into, armed=False)
    held.run(5.0, DRUM)
    assert held.closed() == []
    assert not held.calls.reason_filter.things
    assert not held.hold.standing
    held.human(into)
    held.run(1.0, DRUM)
    if into == AUTO:
        assert (held.autopilot.mode, held.closed()) == (HOLD, [])
    else:
        assert held.closed() == [(1, Outcome.TAKEN_OVER)]


def test_armed_again_in_manual_a_human_drives(held: Scene) -> None:
    reboot(held, MANUAL)
    held.human(MANUAL)
    assert held.closed() == [(1, Outcome.TAKEN_OVER)]
    assert held.calls.hold is None


def test_a_mode_that_is_armed_as_it_boots_is_nobodys(held: Scene) -> None:
    reboot(held, MANUAL, armed=True)
    held.run(20.0, DRUM)
    assert (held.closed(), held.modes(), held.events().count(HoldEvent.FAILED)) == ([], [HOLD], 0)
    held.human(AUTO)
    held.run(1.0, DRUM)
    assert held.modes() == [HOLD, HOLD]


def test_a_go_that_was_given_before_is_void(held: Scene) -> None:
    held.autopilot.deaf = True
    held.go()
    held.run(1.0, CLEAR)
    assert held.hold.state is HoldState.RESUMING
    reboot(held, HOLD)
    held.autopilot.deaf = False
    asked = len(held.modes())
    held.human(HOLD)
    held.run(20.0, CLEAR)
    assert held.calls.go_at is None
    assert len(held.modes()) == asked


@pytest.mark.parametrize("told", [True, False])
def test_a_faults_hold_that_may_end_by_itself_may_not_after_a_reboot(told: bool) -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(1.0)
    scene.run(1.0, BROKEN)
    reboot(scene, HOLD, told=told, seen=BROKEN)
    scene.human(HOLD)
    scene.run(20.0, CLEAR)
    assert scene.calls.call is None
    assert AUTO not in scene.modes()


def test_a_rover_that_was_switched_off_as_a_whole_keeps_its_call(held: Scene) -> None:
    held.restarted()
    held.autopilot.armed = False
    for mode in (INITIALISING, MANUAL):
        held.autopilot.mode = mode
        held.run(1.0, DRUM)
    assert held.closed() == []
    assert (held.call.id, held.hold.id) == (1, 1)


def test_a_px4_that_reboots_keeps_it_too() -> None:
    scene = Scene(Policy.HOLD, mode=px4.MISSION, kind=px4.OFFBOARD_HOLD)
    scene.run(1.0)
    scene.run(2.0, DRUM)
    reboot(scene, px4.LOITER, told=False)
    scene.run(2.0, DRUM)
    assert scene.call.id == 1
    assert scene.hold.mode == px4.LOITER
    assert scene.events()[-2:] == [HoldEvent.REBOOTED, HoldEvent.CONFIRMED]


@pytest.mark.slow
@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("mode", [AUTO, GUIDED])
def test_one_that_arms_itself_to_drive_after_it_rebooted_is_held_until_a_go(
    hold: Scene, mode: int, told: bool
) -> None:
    reboot(hold, mode, told=told, seen=CLEAR)
    hold.run(20.0, CLEAR)
    assert (hold.modes(), hold.calls.hold) == ([], None), "it is not armed yet"
    hold.human(mode)
    hold.run(1.0, CLEAR)
    assert hold.autopilot.mode == HOLD
    assert [started.unasked for started in hold.all(HoldStarted)] == [Unasked.REBOOTED]
    hold.run(60.0, CLEAR)
    assert (hold.autopilot.mode, hold.calls.stage()) == (HOLD, Stage.CLEAR)
    hold.go()
    hold.run(20.0, CLEAR)
    assert hold.autopilot.mode == mode
    assert len(hold.all(HoldStarted)) == 1


@pytest.mark.parametrize("silent", [0.0, 2.0, 4.0])
def test_one_that_is_armed_in_auto_with_its_first_heartbeat_is_known_by_its_clock(
    hold: Scene, silent: float
) -> None:
    hold.autopilot.silent = True
    hold.run(silent, CLEAR)
    hold.autopilot.silent = False
    hold.run(0.3, CLEAR)
    assert hold.modes() == []
    hold.autopilot.reboots = 1
    hold.run(1.5, CLEAR)
    assert hold.autopilot.mode == HOLD
    hold.run(20.0, CLEAR)
    assert hold.autopilot.mode == HOLD


def test_one_that_is_armed_as_its_boot_ends_is_held_however_short_it_was(hold: Scene) -> None:
    """As ArduPilot with ARMING_REQUIRE 0 and INITIAL_MODE 10: silent for 2 s, booting, armed in AUTO."""
    hold.autopilot.silent = True
    hold.run(2.0, CLEAR)
    hold.autopilot.silent = False
    hold.human(INITIALISING, armed=False)
    hold.run(1.3, CLEAR)
    hold.human(AUTO)
    hold.run(0.5, CLEAR)
    assert hold.autopilot.mode == HOLD
    hold.run(30.0, CLEAR)
    assert hold.modes() == [HOLD]


def test_such_a_hold_needs_a_go_where_faults_end_theirs_by_themselves() -> None:
    scene = Scene(Policy.HOLD, fault_ends_hold=True)
    scene.run(1.0)
    reboot(scene, AUTO, armed=True, seen=CLEAR)
    scene.autopilot.reboots = 1
    scene.run(30.0, CLEAR)
    assert scene.autopilot.mode == HOLD


@pytest.mark.parametrize("into", [HOLD, MANUAL, LOITER])
@pytest.mark.parametrize("heard", [True, False])
def test_who_arms_one_that_rebooted_and_sets_auto_then_has_set_it(
    hold: Scene, into: int, heard: bool
) -> None:
    """Arming and AUTO may be told by one heartbeat, or by two."""
    reboot(hold, into, seen=CLEAR)
    if heard:
        hold.human(into)
    hold.human(AUTO)
    hold.run(20.0, CLEAR)
    assert (hold.modes(), hold.autopilot.mode) == ([], AUTO)


def test_a_mode_that_a_px4_tells_before_it_tells_that_it_is_armed_is_somebody_s_too() -> None:
    """CURRENT_MODE tells a new mode sooner than the heartbeat, and does not tell whether it is armed."""
    scene = Scene(Policy.HOLD, mode=px4.MISSION, kind=px4.OFFBOARD_HOLD)
    scene.run(1.0)
    reboot(scene, px4.LOITER, told=False, seen=CLEAR)
    sooner = replace(scene.calls.monitor.newest, mode=px4.MISSION)
    scene.keep(scene.calls.vehicle_reported(sooner, scene.now))
    scene.human(px4.MISSION)
    scene.run(20.0, CLEAR)
    assert (scene.modes(), scene.autopilot.mode) == ([], px4.MISSION)


def test_a_human_s_other_mode_over_such_a_hold_is_a_human_s(hold: Scene) -> None:
    reboot(hold, AUTO, seen=CLEAR)
    hold.autopilot.deaf = True
    hold.human(AUTO)
    hold.human(GUIDED)
    hold.autopilot.deaf = False
    hold.run(20.0, CLEAR)
    assert hold.events()[-1] is HoldEvent.TAKEN_OVER
    assert hold.autopilot.mode == GUIDED


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW, Policy.OFF])
def test_in_no_other_policy_is_one_that_reboots_held(policy: Policy) -> None:
    scene = Scene(policy)
    scene.run(1.0)
    reboot(scene, AUTO, seen=CLEAR)
    scene.human(AUTO)
    scene.run(5.0, CLEAR)
    assert scene.modes() == []


def test_nor_is_one_that_rebooted_in_such_a_policy_held_for_that_later() -> None:
    scene = Scene(Policy.REPORT)
    scene.run(1.0)
    reboot(scene, AUTO, seen=CLEAR)
    scene.human(AUTO)
    scene.run(60.0, CLEAR)
    scene.policy(Policy.HOLD)
    scene.run(5.0, CLEAR)
    assert scene.modes() == []


def test_a_silence_alone_is_no_reboot(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(8.0, CLEAR)
    hold.autopilot.silent = False
    hold.run(20.0, CLEAR)
    assert hold.modes() == []


def test_nor_is_a_disarming_that_the_companion_slept_through(hold: Scene) -> None:
    hold.now += 20.0
    hold.calls.monitor.forget(hold.now, 20.0)
    hold.autopilot.armed = False
    hold.run(2.0, CLEAR)
    hold.human(AUTO)
    hold.run(5.0, CLEAR)
    assert hold.modes() == []
