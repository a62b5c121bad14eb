"""Computes how long and how far the rover may go on until it stands, and measures the figures for that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

from companion.sim.field.onboard import install
from companion.sim.field.rover import STANDSTILL, STEP, MotorDrive, Rover
from companion.sim.field.simulation import Simulation
from companion.sim.field.things import World
from companion.vehicle.brakes import ARDUPILOT, Brakes, fit

SPARE = 1.0
"""Seconds granted beyond what is computed: a heartbeat's period."""


@dataclass(frozen=True)
class Limit:
    """The limit from a fault to standstill, as `companion check` computes it: drive on, then brake.

    freshness: T in s, after which the companion may not say OK. timeout: s of silence after which the script
    on the autopilot acts. speed: m/s at the fault; the rover really drives it, and does not overshoot it.
    most: m that are allowed at most, however fast.
    """

    freshness: float
    timeout: float
    speed: float
    most: float = math.inf

    @property
    def noticed(self) -> float:
        """Seconds until somebody orders HOLD."""
        return self.freshness + self.timeout + SPARE

    @property
    def seconds(self) -> float:
        return self.noticed + braking(self.speed)[0]

    @property
    def metres(self) -> float:
        return min(self.most, self.speed * self.noticed + brakes().way(self.speed))


@cache
def brakes() -> Brakes:
    """Returns the brakes as the demo's and the bench's configuration have them."""
    found = fit(ARDUPILOT)
    return Brakes.of(found.braking, found.time_constant)


@cache
def script_timeout() -> float:
    """Returns ATS_TIMEOUT as the shipped script sets it, in s. RuntimeError if the script does not run."""
    simulation = Simulation(World(1, ()), lambda *_: True)
    autopilot = simulation.autopilot
    missing = install(autopilot)
    if missing:
        raise RuntimeError(missing)
    autopilot.poll(0.0)
    return autopilot.parameters["ATS_TIMEOUT"]


@lru_cache(256)
def braking(speed: float) -> tuple[float, float]:
    """Measures seconds and metres from HOLD to standstill of the simulated rover, at `speed` m/s."""
    rover = Rover(World(1, ()).trail, cruise_speed=speed)
    rover.drive = MotorDrive.FOLLOW
    while rover.speed < 0.99 * speed and rover.time < 20.0:
        rover.step(STEP)
    begun, driven = rover.time, rover.distance
    rover.drive = MotorDrive.HOLD
    while rover.speed > STANDSTILL:
        rover.step(STEP)
    return rover.time - begun, rover.distance - driven
