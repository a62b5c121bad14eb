"""One broken wire: an autopilot that was heard and is silent is a fault, told and not acted upon."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anytraverse.assessment import Reason
from companion.wire.ids import Policy, State
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, HOLD, Scene, reported


def test_three_seconds_without_its_heartbeat_are_a_fault_under_hold(hold: Scene) -> None:
    hold.autopilot.silent = True
    silent_for = hold.now - hold.autopilot.beat_at
    hold.run(2.9 - silent_for)
    assert hold.calls.state(hold.now) is State.OK
    hold.run(0.2)
    assert hold.calls.state(hold.now) is State.FAULT
    assert hold.calls.reasons(hold.now) == {Reason.FAULT}


def test_nothing_is_commanded_and_no_hold_begun_for_it(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(60.0, CLEAR)
    assert (hold.modes(), hold.held(), hold.calls.current_id) == ([], [], 0)


def test_it_ends_by_itself_two_seconds_after_the_heartbeat_is_back(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(10.0)
    hold.autopilot.silent = False
    hold.run(1.9)
    assert hold.calls.state(hold.now) is State.FAULT
    hold.run(0.3)
    assert hold.calls.state(hold.now) is State.OK


def test_a_wire_that_comes_and_goes_stays_a_fault(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(4.0)
    for _ in range(5):
        hold.hear()
        hold.run(1.9)
        assert hold.calls.state(hold.now) is State.FAULT
        hold.run(2.1)


@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW, Policy.OFF])
def test_it_is_none_where_the_rover_is_not_held(policy: Policy) -> None:
    scene = Scene(policy)
    scene.run(1.0)
    scene.autopilot.silent = True
    scene.run(10.0)
    assert scene.calls.state(scene.now) is (State.OFF if policy is Policy.OFF else State.OK)
    scene.policy(Policy.HOLD)
    assert scene.calls.state(scene.now) is State.FAULT


def test_nor_before_an_autopilot_was_heard() -> None:
    scene = Scene(Policy.HOLD)
    scene.autopilot.silent = True
    scene.run(30.0)
    assert scene.calls.state(scene.now) is State.OK
    assert scene.restarted().calls.state(scene.now) is not State.FAULT


def test_its_positions_are_no_heartbeat(hold: Scene) -> None:
    heard = hold.calls.monitor.newest.reported_at
    hold.autopilot.silent = True
    for _ in range(5):
        hold.run(1.0)
        hold.calls.vehicle_reported(replace(reported(AUTO, heard), travelled=3.0), hold.now)
    assert hold.calls.state(hold.now) is State.FAULT


def test_the_time_in_which_we_slept_is_not_its_silence(hold: Scene) -> None:
    hold.now += 20.0
    hold.calls.monitor.forget(hold.now, 20.0)
    hold.show(CLEAR, CLEAR, CLEAR)
    assert hold.calls.state(hold.now) is State.OK
    hold.autopilot.silent = True
    hold.run(3.0)
    assert hold.calls.state(hold.now) is State.FAULT


def test_nor_does_sleep_end_the_fault(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(4.0)
    hold.now += 20.0
    hold.calls.monitor.forget(hold.now, 20.0)
    hold.show(CLEAR, CLEAR, CLEAR)
    assert hold.calls.state(hold.now) is State.FAULT


def test_a_call_that_opens_meanwhile_says_so_and_is_held_once_the_mode_is_known(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(6.0)
    hold.run(2.0, DRUM)
    assert (hold.opened(), hold.modes()) == ([1], [])
    assert hold.calls.state(hold.now) is State.FAULT
    hold.autopilot.silent = False
    hold.run(0.2)
    assert hold.modes() == [HOLD]


def test_the_scripts_hold_is_nobodys_takeover_once_the_wire_is_mended(hold: Scene) -> None:
    hold.autopilot.silent = True
    hold.run(5.0)
    hold.autopilot.mode, hold.autopilot.silent = HOLD, False
    hold.run(5.0)
    assert (hold.modes(), hold.held(), hold.calls.current_id) == ([], [], 0)


def test_a_go_waits_until_it_is_no_fault_any_more(held: Scene) -> None:
    held.autopilot.silent = True
    held.run(3.5 - (held.now - held.autopilot.beat_at), CLEAR)
    held.go()
    held.run(1.0, CLEAR)
    assert held.calls.state(held.now) is State.FAULT
    assert held.modes() == [HOLD], "nobody is told to drive on by who says that it is not well"
    held.autopilot.silent = False
    held.run(3.0, CLEAR)
    assert held.modes() == [HOLD, AUTO]
