"""A region of interest that the vehicle does not fit in: refused, or a fault where it is there at a start."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import CorridorSection
from companion.wire.ids import Policy
from companion.wire.parameters import ROI
from tests.companion.daemon.rig import AUTO, HOLD, MakeRig, Rig

LEFT, TOP, RIGHT, BOTTOM = ROI.values()
NARROW = (0.46, 0.6, 0.54, 0.95)
REMEDY = "FAULT: ROI 0.08 wide, vehicle 0.30: widen it"


def narrow(rig: Rig) -> Rig:
    """The same rover, started with a file whose region is too narrow."""
    rig.roi = NARROW
    rig.restart()
    return rig


def test_one_in_the_file_holds_a_rover_that_drives_and_the_remedy_is_told(
    make_rig: MakeRig, caplog: pytest.LogCaptureFixture
) -> None:
    rig = narrow(make_rig())
    rig.see(3.0)
    assert rig.state[0] == "FAULT"
    assert rig.stage.mode == HOLD
    assert REMEDY in rig.left_out
    assert any(text.endswith("FAULT ROI does not fit") for text in rig.texts)
    assert "set AT_ROI_L and AT_ROI_R, or correct [roi] or [corridor] in the file" in caplog.text


@pytest.mark.slow
def test_it_is_a_fault_in_every_policy_and_its_remedy_is_repeated(make_rig: MakeRig) -> None:
    rig = narrow(make_rig(Policy.REPORT))
    rig.see(130.0)
    assert rig.state == ("FAULT", 0)
    assert rig.stage.mode == AUTO
    assert rig.texts.count(REMEDY) == 3
    assert "Companion FAULT: ROI does not fit" in rig.texts


@pytest.mark.slow
def test_the_ground_may_widen_it_in_steps_and_then_it_is_over_and_stays_over(make_rig: MakeRig) -> None:
    rig = narrow(make_rig(Policy.REPORT))
    rig.see(2.0)
    rig.set(LEFT, 0.4)
    rig.see(1.0)
    assert (rig.state[0], rig.echoes(LEFT)[-1]) == ("FAULT", 0.4)
    rig.set(RIGHT, 0.7)
    rig.see(3.0)
    assert rig.state == ("OK", 0)
    rig.set(RIGHT, 0.6)
    rig.see(1.0)
    assert rig.echoes(RIGHT)[-1] == 0.7
    assert "Refused: ROI 0.20 wide, vehicle 0.30: widen it" in rig.texts
    rig.restart()
    rig.see(3.0)
    assert rig.state == ("OK", 0)


def test_a_reset_to_a_file_with_one_is_refused(make_rig: MakeRig) -> None:
    rig = narrow(make_rig(Policy.REPORT))
    rig.set(LEFT, 0.2)
    rig.see(3.0)
    assert rig.state == ("OK", 0)
    store = mavlink.MAV_CMD_PREFLIGHT_STORAGE
    rig.stage.send(mavlink.MAVLink_command_long_message(1, 191, store, 0, 2, 0, 0, 0, 0, 0, 0))
    rig.see(1.0)
    assert REMEDY.replace("FAULT", "Refused") in rig.texts
    assert rig.state == ("OK", 0)


def test_one_that_the_journal_holds_is_a_fault_too(make_rig: MakeRig) -> None:
    rig = make_rig(Policy.REPORT)
    rig.roi = (0.2, 0.6, 0.8, 0.95)
    rig.restart()
    rig.set(LEFT, 0.45)
    rig.see(1.0)
    assert rig.state == ("OK", 0)
    rig.config = replace(rig.config, corridor=CorridorSection(bottom=0.5, top=0.3))
    rig.restart()
    rig.see(3.0)
    assert rig.state == ("FAULT", 0)
    assert rig.left_out == ["FAULT: ROI 0.35 wide, vehicle 0.50: widen it"]
    assert rig.echoes(LEFT) == [0.45]
    rig.set(LEFT, 0.3)
    rig.see(3.0)
    assert rig.state == ("OK", 0)
