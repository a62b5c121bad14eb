"""A rover that drives backwards or out of its camera's view by itself: a fault, a hold, and the way on."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import MountSection
from companion.wire.ids import COMPONENT_ID, Motion, Policy, read_heartbeat_mode
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

PERIOD = 0.5
NORTH_M = 1.0 / 111_320.0


class Drive:
    """Moves a rig's rover and reports that twice a second, as the autopilot does."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.latitude = 47.0
        self.due = 0.0

    def on(self, seconds: float, speed: float, course: float = 0.0, heading: float = 0.0) -> None:
        """The view is fine, and the rover drives at this speed; in HOLD it stands."""
        rig = self.rig
        for _ in range(round(seconds / 0.1)):
            moving = 0.0 if rig.stage.mode == HOLD else speed
            self.latitude += 0.1 * moving * NORTH_M * math.cos(math.radians(course))
            if rig.clock.now >= self.due:
                self.due = rig.clock.now + PERIOD
                rig.stage.send(self._position(moving, course, heading), (1, 1))
            rig.see(0.1)

    def _position(self, speed: float, course: float, heading: float) -> mavlink.MAVLink_message:
        angle = math.radians(course)
        north, east = (round(100 * speed * one) for one in (math.cos(angle), math.sin(angle)))
        return mavlink.MAVLink_global_position_int_message(
            0, round(self.latitude * 1e7), 80_000_000, 0, 0, north, east, 0, round(100 * heading) % 36_000
        )


def by_hand(rig: Rig, mode: int) -> None:
    rig.stage.mode = mode
    rig.stage.heartbeat(1)


def accepted(rig: Rig) -> bool:
    """Whether the newest heartbeat says that a human drives on in spite of the fault."""
    own = [one for one in rig.stage.sent("HEARTBEAT") if one.get_srcComponent() == COMPONENT_ID]
    return read_heartbeat_mode(own[-1].custom_mode).fault_accepted


@pytest.mark.slow
def test_a_rover_that_reverses_in_auto_is_held_and_says_why(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(3.0, 2.0)
    assert rig.stage.mode == AUTO
    drive.on(1.2, -2.0)
    assert rig.stage.mode == HOLD
    assert rig.state == ("FAULT", 1)
    assert rig.texts[-2:] == ["H1 FAULT drives backwards", "H1 holding"]
    drive.on(20.0, 0.0)
    assert rig.texts.count("H1 FAULT drives backwards") == 2, "it is repeated"


def test_driving_out_of_the_view_is_held_too(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(2.0, 2.0, course=25.0)
    assert rig.stage.mode == AUTO
    drive.on(1.2, 2.0, course=40.0)
    assert rig.stage.mode == HOLD
    assert "H1 FAULT drives out of view" in rig.texts


def test_a_camera_that_looks_back_is_told_by_the_mount(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Rig, "config", replace(Rig.config, mount=MountSection(heading=180.0)))
    rig = make_rig()
    drive = Drive(rig)
    drive.on(3.0, -2.0)
    assert rig.stage.mode == AUTO
    drive.on(1.2, 2.0)
    assert rig.stage.mode == HOLD


def test_a_human_may_reverse(rig: Rig) -> None:
    by_hand(rig, MANUAL)
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    assert rig.state == ("OK", 0)
    assert rig.stage.mode == MANUAL
    assert not any("FAULT" in text for text in rig.texts)


def test_without_a_position_nothing_is_judged(rig: Rig) -> None:
    rig.see(10.0)
    assert rig.stage.mode == AUTO
    assert rig.daemon.status.figures()["course"] == "position"
    Drive(rig).on(1.0, 2.0)
    assert rig.daemon.status.figures()["course"] == ""


def test_in_report_it_is_told_and_ends_a_second_after_the_rover_drives_forward(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    drive = Drive(rig)
    drive.on(2.0, -2.0)
    assert rig.state == ("FAULT", 0)
    assert rig.texts == ["Companion FAULT: drives backwards"]
    drive.on(2.0, 2.0)
    assert rig.state == ("OK", 0)
    assert rig.stage.mode == AUTO


@pytest.mark.slow
@pytest.mark.parametrize("ends", [False, True])
def test_it_never_resumes_without_a_go(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, ends: bool
) -> None:
    call = replace(Rig.config.call, fault_ends_hold=ends)
    monkeypatch.setattr(Rig, "config", replace(Rig.config, call=call))
    rig = make_rig()
    drive = Drive(rig)
    drive.on(2.0, -2.0)
    drive.on(30.0, 0.0)
    assert rig.stage.mode == HOLD


@pytest.mark.slow
def test_after_a_restart_it_needs_a_go_all_the_same(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = replace(Rig.config.call, fault_ends_hold=True)
    monkeypatch.setattr(Rig, "config", replace(Rig.config, call=call))
    rig = make_rig()
    drive = Drive(rig)
    drive.on(2.0, -2.0)
    rig.restart()
    drive.on(10.0, 0.0)
    assert rig.stage.mode == HOLD


@pytest.mark.slow
def test_a_go_resumes_and_reversing_again_is_another_hold(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    rig.answer(1, Motion.GO)
    drive.on(1.5, 2.0)
    assert rig.stage.mode == AUTO
    drive.on(5.0, 2.0)
    assert rig.state == ("OK", 0)
    drive.on(2.0, -2.0)
    assert rig.stage.mode == HOLD
    assert "H2 FAULT drives backwards" in rig.texts


@pytest.mark.slow
def test_a_go_from_before_does_not_count(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    rig.answer(1, Motion.GO)
    drive.on(0.2, 0.0)
    rig.answer(1, Motion.STAY, transaction=8)
    drive.on(10.0, 0.0)
    assert rig.stage.mode == HOLD


@pytest.mark.slow
def test_a_human_s_auto_over_the_hold_accepts_it_for_ten_metres(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    assert rig.stage.mode == HOLD
    by_hand(rig, AUTO)
    drive.on(2.0, 0.0)
    assert "H1 driven on for 20 s or 10 m: drives backwards" in rig.texts
    drive.on(4.0, -2.0)
    assert (rig.stage.mode, rig.state[0], accepted(rig)) == (AUTO, "FAULT", True)
    assert any(text.startswith("Holds again in ") and "drives backwards" in text for text in rig.texts)
    drive.on(2.0, -2.0)
    assert (rig.stage.mode, accepted(rig)) == (HOLD, False)
    assert "H2 FAULT drives backwards" in rig.texts


@pytest.mark.slow
def test_a_human_s_auto_accepts_it_for_twenty_seconds(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    by_hand(rig, AUTO)
    drive.on(18.0, 0.0)
    assert rig.state == ("OK", 0)
    assert not any(text.startswith("Holds again") for text in rig.texts), "nothing stands that could hold"
    drive.on(1.5, -2.0)
    assert rig.stage.mode == AUTO
    drive.on(2.0, -2.0)
    assert rig.stage.mode == HOLD


@pytest.mark.slow
def test_manual_over_the_hold_ends_the_fault(rig: Rig) -> None:
    drive = Drive(rig)
    drive.on(5.0, -2.0)
    by_hand(rig, MANUAL)
    drive.on(3.0, -2.0)
    assert (rig.stage.mode, rig.state) == (MANUAL, ("OK", 0))
