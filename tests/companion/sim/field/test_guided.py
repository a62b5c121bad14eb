"""The simulated autopilot obeys targets of a speed and a rate of turning in GUIDED, and nowhere else."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.guided import LASTS
from companion.sim.field.modes import Mode
from companion.sim.field.router import Port
from companion.sim.field.rover import MotorDrive, Rover
from companion.sim.field.trail import Trail
from tests.companion.sim.field.test_autopilot import Bench


def target(vx: float, rate: float = 0.0, *, vy: float = 0.0, mask: int = 1479, frame: int = 8) -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, 0, 0, 0, vx, vy, 0, 0, 0, 0, 0, rate
    )


@pytest.fixture
def bench() -> Bench:
    return guided()


def guided() -> Bench:
    bench = Bench()
    bench.autopilot.arm(on=True)
    bench.set_mode(Port.COMPANION, Mode.GUIDED)
    return bench


def drives(bench: Bench) -> MotorDrive:
    return bench.rover.drive


def stream(bench: Bench, message: Any, seconds: float) -> None:
    for _ in range(round(seconds / 0.2)):
        bench.tell(Port.COMPANION, message)
        bench.pass_time(0.2)


def test_it_drives_with_the_speed_and_the_rate_of_turning_that_are_asked_for(bench: Bench) -> None:
    stream(bench, target(1.0, 0.4), 6.0)
    before = bench.rover.heading
    stream(bench, target(1.0, 0.4), 1.0)
    assert bench.rover.speed == pytest.approx(1.0, abs=0.05)
    turned = math.remainder(bench.rover.heading - before, math.tau)
    assert turned == pytest.approx(-0.4, abs=0.03), "clockwise is positive on the wire"


def test_while_it_gains_speed_it_turns_no_more_sharply_than_the_arc_that_is_asked_for(bench: Bench) -> None:
    start, bearing = (bench.rover.x, bench.rover.y), bench.rover.heading
    centre = (start[0] + 2.5 * math.sin(bearing), start[1] - 2.5 * math.cos(bearing))
    for _ in range(20):
        stream(bench, target(1.0, 0.4), 0.2)
        assert math.hypot(bench.rover.x - centre[0], bench.rover.y - centre[1]) >= 2.4


def test_it_drives_backwards_where_vx_is_negative(bench: Bench) -> None:
    stream(bench, target(-0.8, 0.3), 4.0)
    before = bench.rover.heading
    stream(bench, target(-0.8, 0.3), 1.0)
    assert bench.rover.speed == pytest.approx(-0.8, abs=0.05)
    assert math.remainder(bench.rover.heading - before, math.tau) == pytest.approx(-0.3, abs=0.03)


def test_it_drives_no_faster_than_at_its_cruise_speed(bench: Bench) -> None:
    stream(bench, target(30.0, vy=40.0), 8.0)
    assert bench.rover.speed == pytest.approx(bench.rover.cruise_speed, abs=0.05)


def test_both_frames_that_programs_use_count(bench: Bench) -> None:
    stream(bench, target(1.0, frame=mavlink.MAV_FRAME_LOCAL_NED), 3.0)
    assert bench.rover.speed == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    "message",
    [
        target(1.0, mask=1479 | 8),
        target(1.0, mask=0),
        target(1.0, frame=3),
        target(math.nan),
        target(1.0, math.inf),
    ],
)
def test_targets_that_are_not_simulated_change_nothing(bench: Bench, message: Any) -> None:
    stream(bench, message, 2.0)
    assert bench.rover.speed == 0.0
    assert bench.autopilot.rover.drive is MotorDrive.STOP


def test_three_seconds_without_a_target_stop_it_as_guided_stops_without_one(bench: Bench) -> None:
    stream(bench, target(1.5), 4.0)
    bench.pass_time(LASTS - 0.3)
    assert drives(bench) == MotorDrive.TARGET
    bench.pass_time(0.4)
    assert drives(bench) == MotorDrive.STOP
    assert "target not received last 3secs, stopping" in [
        text.text for text in bench.heard(Port.GCS, "STATUSTEXT")
    ]
    bench.pass_time(4.0)
    assert bench.rover.speed == 0.0


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.AUTO, Mode.MANUAL])
def test_targets_outside_guided_count_for_nothing(bench: Bench, mode: Mode) -> None:
    bench.set_mode(Port.GCS, mode)
    before = bench.rover.drive
    bench.tell(Port.COMPANION, target(1.0, 1.0))
    assert bench.rover.drive is before
    assert bench.rover.target is None


def test_a_target_is_forgotten_where_guided_is_entered_anew_and_stays_where_it_is_set_again(
    bench: Bench,
) -> None:
    bench.tell(Port.COMPANION, target(1.0))
    bench.set_mode(Port.GCS, Mode.GUIDED)
    assert drives(bench) == MotorDrive.TARGET, "a mode that stands is not entered"
    bench.set_mode(Port.GCS, Mode.HOLD)
    bench.set_mode(Port.GCS, Mode.GUIDED)
    assert drives(bench) == MotorDrive.STOP


def test_a_disarmed_rover_does_not_move(bench: Bench) -> None:
    bench.autopilot.arm(on=False)
    stream(bench, target(1.0), 2.0)
    assert bench.rover.speed == 0.0


@pytest.mark.slow
@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(0.02, 1.0)), max_size=12))
def test_whatever_is_asked_for_speed_and_steering_stay_within_the_body_s_limits(
    targets: list[tuple[float, float, float]],
) -> None:
    rover = Rover(Trail(1), cruise_speed=1.5)
    rover.drive = MotorDrive.TARGET
    for speed, turn, seconds in targets:
        rover.target = speed, turn
        before, rate = rover.heading, rover.body.max_steering
        rover.step(seconds)
        assert abs(rover.speed) <= 1.5 + 0.05
        most = 1.55 * math.tan(rate) / rover.body.wheelbase * (seconds + 0.02)
        turned = math.remainder(rover.heading - before, math.tau)
        assert abs(turned) <= min(most, math.pi) + 1e-6


def test_an_item_that_is_made_the_current_one_is_accepted(bench: Bench) -> None:
    assert bench.command(Port.COMPANION, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == 0
    assert bench.command(Port.COMPANION, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, math.nan) == 2
