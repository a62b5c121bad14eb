"""A human who drives on over a hold has accepted the fault that stood, for a while and for some metres."""

from __future__ import annotations

import pytest

from anytraverse.assessment import Reason
from companion.calls.decisions import FaultAcceptanceEnds, FaultAccepted, WouldHold
from companion.calls.faults import ACCEPTANCES, FLICKERS, LAST_SECONDS, TOLD_FOR, WITHIN, Fault, Faults
from companion.calls.numbers import Numbers
from companion.wire.ids import Policy, State
from tests.companion.calls.scenes import AUTO, CLEAR, DRUM, GUIDED, HOLD, MANUAL, Scene


@pytest.fixture
def blind(hold: Scene) -> Scene:
    """Held for two seconds since the camera is broken."""
    hold.camera = False
    hold.run(3.5)
    assert hold.autopilot.mode == HOLD
    return hold


@pytest.mark.parametrize("mode", [AUTO, GUIDED])
def test_the_fault_holds_again_after_twenty_seconds(blind: Scene, mode: int) -> None:
    blind.human(mode)
    blind.run(19.5)
    assert blind.autopilot.mode == mode
    blind.run(1.0)
    assert blind.autopilot.mode == HOLD
    assert blind.held() == [{Reason.FAULT}] * 2


def test_or_after_ten_metres(blind: Scene) -> None:
    blind.autopilot.travelled = 50.0
    blind.run(1.0)
    blind.human(AUTO)
    for metres in range(1, 10):
        blind.autopilot.travelled = 50.0 + metres
        blind.run(1.0)
        assert blind.autopilot.mode == AUTO
    blind.autopilot.travelled = 60.0
    blind.run(1.5)
    assert blind.autopilot.mode == HOLD


def test_it_is_told_once_and_again_before_it_ends(blind: Scene) -> None:
    blind.human(AUTO)
    (told,) = blind.all(FaultAccepted)
    assert told.acceptance is not None
    assert told.acceptance.faults == {Fault.VIEW}
    blind.run(14.0)
    assert not blind.all(FaultAcceptanceEnds)
    blind.run(8.0)
    (ends,) = blind.all(FaultAcceptanceEnds)
    assert ends.seconds == pytest.approx(5.0, abs=0.1)
    assert ends.metres is None


def test_its_last_metres_are_told_too(blind: Scene) -> None:
    blind.autopilot.travelled = 0.0
    blind.run(1.0)
    blind.human(AUTO)
    blind.autopilot.travelled = 7.5
    blind.run(1.5)
    (ends,) = blind.all(FaultAcceptanceEnds)
    assert ends.metres == 2.5


def test_the_state_stays_fault_while_it_is_accepted(blind: Scene) -> None:
    assert not blind.calls.fault_accepted(blind.now)
    blind.human(AUTO)
    assert blind.calls.fault_accepted(blind.now)
    assert blind.calls.state(blind.now) is State.FAULT


def test_a_mode_that_was_set_before_the_hold_was_told_for_a_second_accepts_nothing(hold: Scene) -> None:
    hold.camera = False
    while hold.autopilot.mode != HOLD:
        hold.run(0.05)
    hold.run(0.5)
    hold.human(AUTO)
    hold.run(0.5)
    assert hold.autopilot.mode == HOLD
    assert not hold.all(FaultAccepted)


def test_nor_does_a_mode_in_which_the_human_drives(blind: Scene) -> None:
    blind.human(MANUAL)
    blind.run(2.0)
    blind.human(AUTO)
    blind.run(0.5)
    assert blind.autopilot.mode == HOLD
    assert not blind.all(FaultAccepted)


def test_a_thing_ahead_holds_meanwhile(blind: Scene) -> None:
    blind.human(AUTO)
    blind.camera = True
    blind.run(0.5, DRUM)
    assert blind.autopilot.mode == HOLD
    assert Reason.UNKNOWN_OBJECT in blind.held()[-1]


def test_and_so_does_another_fault(blind: Scene) -> None:
    blind.human(AUTO)
    blind.run(2.0)
    blind.keep(blind.calls.fault_reported(Fault.COURSE, "drives backwards", blind.now))
    blind.run(0.5)
    assert blind.autopilot.mode == HOLD


def test_a_fault_that_began_a_moment_ago_was_not_told_and_is_not_accepted(blind: Scene) -> None:
    blind.keep(blind.calls.fault_reported(Fault.COURSE, "drives backwards", blind.now))
    blind.human(AUTO)
    blind.run(0.5)
    assert blind.autopilot.mode == HOLD


def test_when_it_sees_again_the_acceptance_is_over(blind: Scene) -> None:
    blind.human(AUTO)
    blind.camera = True
    blind.run(2.0, CLEAR)
    assert not blind.calls.fault_accepted(blind.now)
    blind.camera = False
    blind.run(1.5)
    assert blind.autopilot.mode == HOLD


def test_one_good_frame_is_not_seeing_again(blind: Scene) -> None:
    blind.human(AUTO)
    blind.show(CLEAR)
    blind.run(3.0)
    assert blind.autopilot.mode == AUTO


def test_the_fourth_time_in_ten_minutes_is_refused(blind: Scene) -> None:
    for _ in range(ACCEPTANCES):
        blind.human(AUTO)
        assert blind.autopilot.mode == AUTO
        blind.run(25.0)
        assert blind.autopilot.mode == HOLD
    blind.human(AUTO)
    blind.run(0.5)
    assert blind.autopilot.mode == HOLD
    assert blind.all(FaultAccepted)[-1].acceptance is None
    blind.run(WITHIN)
    blind.human(AUTO)
    blind.run(10.0)
    assert blind.autopilot.mode == AUTO


def test_a_lower_policy_drives_on(blind: Scene) -> None:
    blind.policy(Policy.REPORT)
    blind.human(AUTO)
    blind.run(60.0)
    assert blind.autopilot.mode == AUTO


def test_a_fault_of_the_hold_policy_that_is_driven_over_would_not_hold_in_another_one(hold: Scene) -> None:
    hold.keep(hold.calls.fault_reported(Fault.POLICY, "judges too slowly", hold.now))
    hold.run(2.0)
    hold.human(AUTO)
    hold.policy(Policy.SHADOW)
    hold.run(2.0)
    assert hold.all(FaultAccepted)
    assert not hold.all(WouldHold)


def test_the_acceptance_does_not_outlive_a_change_of_policy(blind: Scene) -> None:
    blind.human(AUTO)
    blind.policy(Policy.REPORT)
    blind.policy(Policy.HOLD)
    blind.run(0.5)
    assert blind.autopilot.mode == HOLD


@pytest.mark.parametrize(("told_for", "accepted"), [(TOLD_FOR - 0.125, False), (TOLD_FOR, True)])
def test_a_fault_counts_as_told_from_its_first_second_on(told_for: float, accepted: bool) -> None:
    faults = Faults(Numbers())
    faults.report(Fault.COURSE, 100.0, stands=True)
    assert (faults.accept(100.0 + told_for, None) is not None) == accepted


@pytest.mark.parametrize(("gone_for", "told"), [(FLICKERS, True), (FLICKERS + 0.125, False)])
def test_a_fault_that_was_gone_for_two_seconds_is_the_one_that_was_told(gone_for: float, told: bool) -> None:
    faults = Faults(Numbers())
    faults.report(Fault.COURSE, 100.0, stands=True)
    faults.report(Fault.COURSE, 110.0, stands=False)
    faults.report(Fault.COURSE, 110.0 + gone_for, stands=True)
    assert (faults.accept(110.0 + gone_for, None) is not None) == told


def test_faults_are_accepted_again_ten_minutes_after_the_first_of_three() -> None:
    faults = Faults(Numbers())
    faults.report(Fault.COURSE, 0.0, stands=True)
    for number in range(ACCEPTANCES):
        assert faults.accept(100.0 + number, None) is not None
    assert faults.refuses(100.0 + WITHIN - 0.125)
    assert not faults.refuses(100.0 + WITHIN)


def test_its_end_is_not_told_in_a_standstill_in_which_no_fault_stands() -> None:
    faults = Faults(Numbers())
    faults.report(Fault.COURSE, 0.0, stands=True)
    assert faults.accept(100.0, None) is not None
    soon = 100.0 + Numbers().accepted_for - LAST_SECONDS
    faults.report(Fault.COURSE, soon, stands=False)
    assert faults.tick(soon, None, sees=True) is None
    faults.report(Fault.COURSE, soon + 1.0, stands=True)
    assert faults.tick(soon + 1.0, None, sees=False) is faults.acceptance is not None
