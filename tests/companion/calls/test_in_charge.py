"""When the companion is in charge: in a mode that drives by itself, or in its own hold, and nowhere else."""

from __future__ import annotations

import pytest

from companion.vehicle import Autopilot, px4
from companion.wire.ids import Policy
from tests.companion.calls.scenes import CLEAR, DRUM, PX4_RTL, Scene

MISSION, LOITER, POSITION = px4.MISSION, px4.LOITER, px4.custom_mode(3)
each = pytest.mark.parametrize("kind", [px4.LOITERING, px4.OFFBOARD_HOLD], ids=["loiter", "offboard"])


def driving(kind: Autopilot = px4.LOITERING, mode: int = MISSION) -> Scene:
    scene = Scene(Policy.HOLD, mode=mode, kind=kind)
    scene.run(1.0, CLEAR)
    return scene


def in_charge(scene: Scene) -> bool:
    return scene.calls.holding.in_charge(scene.now)


@each
def test_from_the_mission_through_the_hold_and_back_it_is_without_a_gap(kind: Autopilot) -> None:
    scene = driving(kind)
    seen = []
    for step in range(120):
        if step == 60:
            scene.go()
        scene.run(0.05, DRUM if step < 60 else CLEAR)
        seen.append(in_charge(scene))
    assert scene.modes() == [kind.hold_mode, MISSION]
    assert all(seen)


@pytest.mark.parametrize("mode", [LOITER, POSITION, PX4_RTL, px4.OFFBOARD])
def test_a_human_s_mode_ends_it_out_of_a_mission_and_the_mission_begins_it_again(mode: int) -> None:
    scene = driving()
    scene.autopilot.mode = mode
    scene.run(0.2)
    assert not in_charge(scene)
    scene.autopilot.mode = MISSION
    scene.run(0.2)
    assert in_charge(scene)


@each
@pytest.mark.parametrize("mode", [POSITION, PX4_RTL])
def test_a_human_s_mode_ends_it_out_of_a_hold(kind: Autopilot, mode: int) -> None:
    scene = driving(kind)
    scene.run(2.0, DRUM)
    assert scene.autopilot.mode == kind.hold_mode
    assert in_charge(scene)
    scene.autopilot.mode = mode
    scene.run(0.2)
    assert scene.calls.hold is None
    assert not in_charge(scene)


def test_it_is_not_while_the_vehicle_is_disarmed() -> None:
    scene = driving()
    scene.autopilot.armed = False
    scene.run(0.2)
    assert not in_charge(scene)


def test_a_silent_autopilot_ends_it_after_three_seconds() -> None:
    scene = driving()
    scene.autopilot.silent = True
    scene.run(2.0)
    assert in_charge(scene)
    scene.run(1.5)
    assert not in_charge(scene)


def test_after_the_process_hung_it_is_not_before_the_mode_is_reported_again() -> None:
    scene = driving()
    scene.autopilot.silent = True
    scene.calls.monitor.forget(scene.now, 1.5)
    scene.run(0.5)
    assert not in_charge(scene)
    scene.autopilot.silent = False
    scene.run(1.0)
    assert in_charge(scene)
