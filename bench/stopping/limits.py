"""How long the rover may take to stand, and where the figures for that come from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from companion.field.onboard import install
from companion.field.rover import STANDSTILL, STEP, Drive, Rover
from companion.field.simulation import Simulation
from companion.field.things import World

SPARE = 1.0
"""Seconds granted beyond what is reckoned: a heartbeat's period."""


@dataclass(frozen=True)
class Limit:
    """Seconds from a fault to standstill.

    freshness: T, after which the companion may not say OK. timeout: the silence after which the script on the
    autopilot acts. braking: from the order to standstill.
    """

    freshness: float
    timeout: float
    braking: float

    @property
    def seconds(self) -> float:
        return self.freshness + self.timeout + SPARE + self.braking


@cache
def script_timeout() -> float:
    """ATS_TIMEOUT as the shipped script sets it, in seconds. RuntimeError where it does not run."""
    simulation = Simulation(World(1, ()), lambda *_: True)
    autopilot = simulation.autopilot
    missing = install(autopilot)
    if missing:
        raise RuntimeError(missing)
    autopilot.poll(0.0)
    return autopilot.parameters["ATS_TIMEOUT"]


def braking(speed: float) -> tuple[float, float]:
    """Seconds and metres that the simulated rover takes from an order to stand, at `speed` m/s."""
    rover = Rover(World(1, ()).trail, cruise_speed=speed)
    rover.drive = Drive.FOLLOW
    while rover.speed < 0.99 * speed and rover.time < 20.0:
        rover.step(STEP)
    begun, driven = rover.time, rover.distance
    rover.drive = Drive.BRAKE
    while rover.speed > STANDSTILL:
        rover.step(STEP)
    return rover.time - begun, rover.distance - driven
