"""Policy hold that cannot be given: a fault that holds the rover, and never another policy."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.wire.ids import Policy
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

SLOW = 0.47
"""Seconds a frame: two of them and a period exceed T = 1 s by a little."""
REMINDER = "FAULT: 0.5 s a frame: faster, or AT_POLICY 0"
TO_ARM = "To arm for MANUAL in a FAULT: ATS_NEED 0"


@pytest.mark.slow
def test_one_slow_frame_at_the_start_changes_nothing(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.step_time = 0.6
    rig.restart()
    rig.see(30.0)
    assert rig.told_policy is Policy.HOLD
    assert rig.state == ("OK", 0)
    assert rig.stage.mode == AUTO
    assert not any("FAULT" in text for text in rig.texts)


def test_frames_that_are_slow_for_five_seconds_hold_a_rover_that_drives(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    rig.see(5.0)
    rig.child.frame_s = SLOW
    rig.see(4.5)
    assert rig.state == ("OK", 0)
    rig.see(1.0)
    assert rig.told_policy is Policy.HOLD
    assert rig.state == ("FAULT", 1)
    assert rig.stage.mode == HOLD
    assert "H1 FAULT judges too slowly" in rig.texts
    assert rig.texts.count(REMINDER) == 1, "the hold does not say what to do"
    assert rig.texts.count(TO_ARM) == 1
    assert "hold cannot be given: a frame takes 0.47 s" in caplog.text
    assert rig.daemon.status.figures()["hold_refused"] == "HOLD refused: 0.5 s a frame: make it faster"


@pytest.mark.slow
def test_frames_that_are_quick_for_ten_seconds_end_it(rig: Rig) -> None:
    rig.child.frame_s = SLOW
    rig.see(6.5)
    rig.child.frame_s = 0.02
    rig.see(9.5)
    assert rig.state[0] == "FAULT"
    rig.see(1.0)
    assert rig.state[0] != "FAULT"
    assert rig.daemon.status.figures()["hold_refused"] == ""
    assert rig.stage.mode == HOLD, "nothing resumes by itself"
    assert rig.told_policy is Policy.HOLD


@pytest.mark.slow
def test_one_slow_frame_in_the_ten_seconds_does_not_prolong_it(rig: Rig) -> None:
    rig.child.frame_s = SLOW
    rig.see(6.5)
    for step, seconds in ((0.02, 5.0), (SLOW, 0.1), (0.02, 5.5)):
        rig.child.frame_s = step
        rig.see(seconds)
    assert rig.state[0] != "FAULT"


@pytest.mark.slow
def test_in_manual_it_is_told_once_a_minute_until_the_ground_sets_another_policy(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.stage.mode = MANUAL
    rig.step_time = 0.6
    rig.restart()
    rig.child.frame_s = 0.6
    rig.see(135.0)
    reminder = "FAULT: 0.6 s a frame: faster, or AT_POLICY 0"
    assert rig.texts.count(reminder) == 3
    assert rig.state == ("FAULT", 0)
    assert rig.stage.mode == MANUAL
    rig.set("AT_POLICY", float(Policy.REPORT))
    rig.see(130.0)
    assert rig.texts.count(reminder) == 3
    assert rig.texts.count(TO_ARM) == 1
    assert rig.told_policy is Policy.REPORT
    assert rig.state == ("OK", 0)


def test_a_request_for_hold_in_it_is_refused_and_the_policy_stays(rig: Rig) -> None:
    rig.child.frame_s = SLOW
    rig.see(6.5)
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.0)
    assert "HOLD refused: 0.5 s a frame: make it faster" in rig.texts
    assert rig.told_policy is Policy.HOLD
    assert rig.echoes("AT_POLICY")[-1] == float(Policy.HOLD)


@pytest.mark.slow
def test_who_asked_for_hold_in_vain_is_told_once_when_it_fits(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    rig.child.frame_s = SLOW
    rig.see(7.0)
    assert rig.state == ("OK", 0), "in policy report that is no fault"
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.0)
    told, fits = [rig.told_policy], "HOLD fits again: set AT_POLICY 2"
    assert fits not in rig.texts
    rig.child.frame_s = 0.02
    rig.see(20.0)
    assert rig.texts.count(fits) == 1
    rig.set("AT_POLICY", float(Policy.HOLD))
    rig.see(1.0)
    assert [*told, rig.told_policy] == [Policy.REPORT, Policy.HOLD]


def test_the_missing_figures_for_stopping_hold_a_rover_that_drives_from_the_start(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.config = Config()
    rig.restart()
    rig.see(2.0)
    assert rig.told_policy is Policy.HOLD
    assert rig.state[0] == "FAULT"
    assert rig.stage.mode == HOLD
    assert "FAULT: set [mount], [stopping], or AT_POLICY 0" in rig.texts


def test_a_persons_lower_policy_ends_the_fault_and_lets_the_rover_go(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.config = Config()
    rig.restart()
    rig.see(2.0)
    rig.set("AT_POLICY", float(Policy.REPORT))
    rig.see(3.0)
    told = [rig.told_policy]
    assert rig.state == ("OK", 0)
    rig.stage.mode = AUTO
    rig.see(5.0)
    assert rig.stage.mode == AUTO
    rig.restart()
    rig.see(1.0)
    told.append(rig.told_policy)
    assert told == [Policy.REPORT, Policy.HOLD], "a restart keeps only off: else the configured one counts"


def test_what_outruns_its_eyes_can_be_mended_in_steps(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.config = replace(
        Config(),
        mount=MountSection(height=1.0, tilt=10.0),
        stopping=StoppingSection(speed=1.0, time_constant=0.1, braking=1.0),
    )
    rig.roi = (1 / 3, 0.85, 2 / 3, 0.95)
    rig.restart()
    rig.see(1.0)
    assert rig.state[0] == "FAULT"
    assert any(text.startswith("FAULT: 1.0 m/s: at most 0.") for text in rig.texts)
    for top in (0.8, 0.5):
        rig.set("AT_ROI_T", top)
        rig.see(1.0)
        assert rig.echoes("AT_ROI_T")[-1] == top
    rig.see(3.0)
    assert rig.state[0] != "FAULT"
    rig.set("AT_ROI_T", 0.8)
    rig.see(1.0)
    assert rig.echoes("AT_ROI_T")[-1] == 0.5, "now it would take hold away"
