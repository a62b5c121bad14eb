"""How the rover leans, in virtual time."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import telemetry
from companion.sim.field.modes import Mode
from companion.sim.field.motion import BUMP_GAP, SEEN, Attitude, RoverMotion
from companion.sim.field.rover import Rover
from companion.sim.field.simulation import Simulation
from companion.sim.field.things import World
from companion.sim.field.trail import Trail

TRAIL = Trail(1)
FIVE = math.radians(5.0)
PLACES = np.arange(0.0, TRAIL.length, 0.02)
moved = partial(RoverMotion, TRAIL, 1)


def test_a_rover_without_motion_is_level_and_its_attitude_is_the_bytes_it_was() -> None:
    rover = Rover(TRAIL)
    rover.speed = 2.0
    rover.step(3.0)
    assert RoverMotion(TRAIL).at(3.0, 7.0, 2.0) == Attitude()
    message = telemetry.attitude(rover)
    level = mavlink.MAVLink_attitude_message(message.time_boot_ms, 0.0, 0.0, message.yaw, 0.0, 0.0, 0.0)
    link = mavlink.MAVLink(None, 1, 1)
    assert message.pack(link) == level.pack(link)


def test_it_swings_by_so_many_degrees_while_it_drives() -> None:
    swing = moved(swing=FIVE)
    pitch, roll = np.array([swing.at(t, 0.0, 1.0)[:2] for t in np.arange(0, 30, 0.02)]).T
    assert pitch.max() == -pitch.min() == pytest.approx(FIVE, rel=1e-3)
    assert roll.max() == pytest.approx(0.6 * FIVE, rel=1e-3)
    assert np.count_nonzero(np.diff(np.sign(pitch))) == pytest.approx(30 * 2 * 0.7, abs=1)
    assert np.count_nonzero(np.diff(np.sign(roll))) == pytest.approx(30 * 2 * 0.53, abs=1)


def test_the_swing_ends_smoothly_with_the_speed() -> None:
    swing = moved(swing=FIVE)
    sizes = [
        max(abs(swing.at(t, 0.0, v).pitch) for t in np.arange(0, 3, 0.02)) for v in np.arange(0, 1, 0.05)
    ]
    assert sizes[0] == 0
    assert np.all(np.diff(sizes) >= 0)
    assert np.diff(sizes).max() < 0.2 * FIVE


def test_a_rover_that_stands_is_still() -> None:
    motion = moved(swing=FIVE, bumps=FIVE, slopes=FIVE)
    stood = {motion.at(t, 31.0, 0.0) for t in np.arange(0, 10, 0.3)}
    assert len(stood) == 1
    assert stood.pop()[2:4] == (0.0, 0.0)


@pytest.mark.slow
def test_bumps_are_short_lie_about_every_six_metres_and_stay_where_they_are() -> None:
    bumps = moved(bumps=FIVE)
    pitch, roll = np.array([bumps.at(0.0, s, 1.0)[:2] for s in PLACES]).T
    begun = np.count_nonzero(np.diff((pitch != 0).astype(int)) == 1)
    assert begun == pytest.approx(TRAIL.length / BUMP_GAP, abs=1)
    assert (pitch != 0).mean() * TRAIL.length / begun == pytest.approx(0.5, abs=0.05)
    assert np.abs(pitch).max() == pytest.approx(FIVE, rel=1e-2)
    assert 0 < np.abs(roll).max() <= FIVE
    assert [bumps.at(9.0, s + TRAIL.length, 2.0).pitch for s in PLACES[::50]] == pytest.approx(pitch[::50])
    other = RoverMotion(TRAIL, 2, bumps=FIVE)
    assert [other.at(0.0, s, 1.0).pitch for s in PLACES] != list(pitch)


def test_the_trail_climbs_and_falls_slowly_by_so_many_degrees_and_closes() -> None:
    slopes = moved(slopes=FIVE)
    pitch = np.array([slopes.at(0.0, s, 1.0).pitch for s in PLACES])
    assert np.abs(pitch).max() == pytest.approx(FIVE, rel=1e-3)
    assert abs(np.tan(pitch).mean()) < 1e-6
    assert np.abs(np.gradient(pitch, PLACES)).max() < FIVE * math.tau / 25


def test_the_camera_sees_the_slope_ahead_and_the_rover_feels_the_one_below() -> None:
    slopes = moved(slopes=FIVE)
    for s in PLACES[::400]:
        here = slopes.at(0.0, s, 1.0)
        way = [math.tan(slopes.at(0.0, at, 1.0).pitch) for at in np.linspace(s + SEEN[0], s + SEEN[1], 200)]
        assert math.tan(here.slope_ahead) == pytest.approx(np.mean(way), abs=1e-4)
        assert here.tilt == (here.pitch - here.slope_ahead, here.roll)


def test_a_rover_that_looks_back_sees_a_climb_as_a_fall() -> None:
    slopes = moved(slopes=FIVE)
    there, back = slopes.at(0.0, 20.0, 1.0), slopes.at(0.0, 20.0, 1.0, math.pi)
    assert back.pitch == pytest.approx(-there.pitch)
    assert back.slope_ahead == pytest.approx(-slopes.at(0.0, 20.0 - sum(SEEN), 1.0).slope_ahead)


def test_the_rates_are_those_of_the_angles() -> None:
    motion, speed, step = moved(swing=FIVE, bumps=FIVE, slopes=FIVE), 2.0, 0.01
    driven = np.array([motion.at(t, 3.0 + speed * t, speed)[:4] for t in np.arange(0, 20, step)])
    for angles, rates in ((driven[:, 0], driven[:, 2]), (driven[:, 1], driven[:, 3])):
        assert np.abs(np.gradient(angles, step) - rates)[1:-1].max() < 0.05 * np.abs(rates).max()


def test_attitude_and_status_carry_the_angles_of_the_frame_of_the_same_moment() -> None:
    world = World(1, ())
    motion = RoverMotion(world.trail, 1, swing=FIVE, bumps=FIVE, slopes=FIVE)
    simulation = Simulation(world, lambda *_: True, motion=motion)
    simulation.autopilot.arm(on=True)
    simulation.autopilot.set_mode(Mode.AUTO, "hand")
    leaned = set()
    for _ in range(40):
        simulation.advance(0.2)
        heard, status, seen = (
            telemetry.attitude(simulation.rover),
            simulation.status(),
            simulation.rover.attitude,
        )
        assert (heard.pitch, heard.roll) == seen[:2]
        assert (heard.pitchspeed, heard.rollspeed) == seen[2:4]
        assert math.radians(status["pitch"]) == pytest.approx(heard.pitch)
        assert math.radians(status["roll"]) == pytest.approx(heard.roll)
        assert seen.tilt.pitch == pytest.approx(heard.pitch - math.radians(status["slope_ahead"]))
        leaned.add(round(heard.pitch, 3))
    assert len(leaned) > 20
