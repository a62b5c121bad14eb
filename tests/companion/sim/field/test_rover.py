"""The rover in virtual time."""

from __future__ import annotations

import math

import pytest

from companion.sim.field.rover import STEP, MotorDrive, Rover
from companion.sim.field.trail import Trail
from companion.vehicle.brakes import ARDUPILOT, Brakes, Measured, fit


@pytest.fixture(scope="module")
def trail() -> Trail:
    return Trail(3)


def drive(rover: Rover, how: MotorDrive, seconds: float) -> None:
    rover.drive = how
    rover.step(seconds)


def test_a_rover_at_cruise_speed_needs_two_to_three_metres_to_stop(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 8.0)
    assert rover.speed == pytest.approx(2.5, abs=0.05)
    before = rover.distance
    drive(rover, MotorDrive.BRAKE, 4.0)
    assert rover.speed == 0.0
    assert 2.0 <= rover.distance - before <= 3.0


@pytest.mark.parametrize("measured", ARDUPILOT)
def test_in_hold_it_takes_the_way_that_ardupilot_takes(trail: Trail, measured: Measured) -> None:
    rover = Rover(trail, cruise_speed=measured.speed)
    drive(rover, MotorDrive.FOLLOW, 12.0)
    assert rover.speed == pytest.approx(measured.speed, abs=0.02)
    before = rover.distance
    drive(rover, MotorDrive.HOLD, 15.0)
    assert rover.speed == 0.0
    assert rover.distance - before == pytest.approx(measured.way, rel=0.025)


def test_what_is_fitted_to_ardupilot_s_stops_is_not_shorter_than_the_rover_s(trail: Trail) -> None:
    found = fit(ARDUPILOT)
    brakes = Brakes.of(found.braking, found.time_constant)
    for speed in (0.3, 0.5, 1.0, 1.5, 2.0, 2.5, 3.5, 5.0):
        rover = Rover(trail, cruise_speed=speed)
        drive(rover, MotorDrive.FOLLOW, 12.0)
        before = rover.distance
        drive(rover, MotorDrive.HOLD, 15.0)
        assert rover.distance - before <= brakes.way(speed)


def test_a_faster_rover_needs_more_than_in_proportion_to_its_speed(trail: Trail) -> None:
    def metres_to_stop(speed: float) -> float:
        rover = Rover(trail, cruise_speed=speed)
        drive(rover, MotorDrive.FOLLOW, 12.0)
        before = rover.distance
        drive(rover, MotorDrive.BRAKE, 8.0)
        return rover.distance - before

    assert metres_to_stop(4.0) > 2.0 * metres_to_stop(2.0)


def test_brakes_act_only_after_the_reaction_time(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 8.0)
    cruising = rover.speed
    drive(rover, MotorDrive.BRAKE, 0.1)
    assert rover.speed == pytest.approx(cruising, abs=0.01)
    rover.step(0.2)
    assert rover.speed < cruising - 0.1


def test_it_gathers_speed_at_about_one_metre_per_second_squared(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 1.15)
    assert rover.speed == pytest.approx(1.0, abs=0.1)


def test_it_keeps_to_the_middle_of_the_path_for_a_whole_lap(trail: Trail) -> None:
    rover = Rover(trail)
    rover.drive = MotorDrive.FOLLOW
    worst = 0.0
    for _ in range(round((trail.length / 2.5 + 5.0) / 0.1)):
        rover.step(0.1)
        worst = max(worst, abs(trail.nearest(rover.x, rover.y)[1]))
    assert rover.laps == 1
    assert worst < 0.3


def test_a_restarted_mission_leads_back_to_the_start_and_on_from_there(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 15.0)
    drive(rover, MotorDrive.BRAKE, 3.0)
    rover.restart_mission()
    start = trail.pose(trail.start)
    rover.drive = MotorDrive.FOLLOW
    nearest = math.inf
    for _ in range(600):
        rover.step(0.1)
        nearest = min(nearest, math.hypot(rover.x - start.x, rover.y - start.y))
    assert nearest < 3.0
    assert abs(trail.nearest(rover.x, rover.y)[1]) < 0.5


def test_a_rover_left_alone_by_the_hand_coasts_to_a_stop_farther_than_its_brakes_take(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 8.0)
    before = rover.distance
    drive(rover, MotorDrive.HAND, 12.0)
    assert rover.speed == 0.0
    assert rover.distance - before > 5.0


@pytest.mark.parametrize(("throttle", "sign"), [(0.6, 1.0), (-0.6, -1.0)])
def test_the_hand_drives_forwards_and_backwards(trail: Trail, throttle: float, sign: float) -> None:
    rover = Rover(trail)
    rover.transmitter.throttle = throttle
    drive(rover, MotorDrive.HAND, 2.0)
    assert sign * rover.speed > 0.3


def test_the_hand_never_exceeds_the_top_speed_and_steers_left_with_positive_steering(trail: Trail) -> None:
    rover = Rover(trail)
    rover.transmitter.throttle, rover.transmitter.steering = 1.0, 0.05
    before = rover.heading
    drive(rover, MotorDrive.HAND, 0.8)
    assert rover.heading > before
    drive(rover, MotorDrive.HAND, 20.0)
    assert rover.speed <= rover.body.top_speed + 0.05


def test_standstill_counts_only_the_time_it_stands(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.OFF, 3.0)
    assert rover.standstill == pytest.approx(3.0, abs=2 * STEP)
    drive(rover, MotorDrive.FOLLOW, 3.0)
    assert rover.standstill == pytest.approx(3.0 + rover.body.reaction, abs=0.1)


def test_many_small_steps_and_few_big_ones_end_in_the_same_place(trail: Trail) -> None:
    small, big = Rover(trail), Rover(trail)
    small.drive = big.drive = MotorDrive.FOLLOW
    for _ in range(1000):
        small.step(0.007)
    for _ in range(20):
        big.step(0.35)
    assert (small.x, small.y, small.speed) == pytest.approx((big.x, big.y, big.speed), abs=1e-6)


def test_a_reversed_mission_backs_along_the_trail_the_way_it_came_and_forward_again(trail: Trail) -> None:
    rover = Rover(trail)
    drive(rover, MotorDrive.FOLLOW, 20.0)
    before = rover.s
    rover.reversed = True
    worst = 0.0
    for _ in range(200):
        rover.step(0.1)
        worst = max(worst, abs(trail.nearest(rover.x, rover.y)[1]))
    assert rover.speed == pytest.approx(-2.5, abs=0.05)
    assert (before - rover.s) % trail.length == pytest.approx(40.0, abs=8.0)
    assert worst < 0.3
    nose = math.remainder(rover.heading - trail.pose(rover.s).heading, math.tau)
    assert abs(nose) < 0.5, "it did not turn round"
    rover.reversed = False
    drive(rover, MotorDrive.FOLLOW, 5.0)
    assert rover.speed == pytest.approx(2.5, abs=0.05)


def test_in_hold_it_stops_from_reversing_as_from_driving_forward(trail: Trail) -> None:
    ways = []
    for backwards in (False, True):
        rover = Rover(trail, cruise_speed=2.0)
        rover.reversed = backwards
        drive(rover, MotorDrive.FOLLOW, 12.0)
        assert abs(rover.speed) == pytest.approx(2.0, abs=0.02)
        before = rover.distance
        drive(rover, MotorDrive.HOLD, 15.0)
        assert rover.speed == 0.0
        ways.append(rover.distance - before)
    assert ways[1] == pytest.approx(ways[0], rel=0.02)
