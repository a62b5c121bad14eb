"""The way from HOLD to standstill, fitted to measured stops. Pure: figures in, figures out.

A vehicle whose autopilot slows it down by a controller does not stop in v^2 / 2a: at walking pace it takes
about two seconds times its speed. Two figures describe both: a time constant and a deceleration.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

OVERSHOOT = 1.12
"""Times the speed that it was told to drive: an ArduPilot with WP_SPEED 2 reached 2.25 m/s in simulation."""
CAUTIOUS = 2.1
"""Seconds times speed: the time constant that counts where none is configured. No stop below took more."""
MOST = 100.0
"""m/s2. A deceleration that adds nothing to the time constant."""
SPREAD = 1.5
"""The fastest of the stops must be this many times as fast as the slowest, or two figures mean nothing."""


class Measured(NamedTuple):
    """One stop. speed: m/s when HOLD was set. way: m from there to standstill."""

    speed: float
    way: float


ARDUPILOT = tuple(
    Measured(*pair)
    for pair in (
        (0.61, 1.0),
        (0.88, 1.5),
        (1.35, 2.5),
        (1.84, 3.5),
        (2.83, 5.6),
        (3.84, 7.8),
        (4.85, 10.0),
    )
)
"""HOLD from steady speed: ArduPilot Rover 4.7-dev in its own simulation."""


@dataclass(frozen=True)
class Brakes:
    """The way is the longest that one of `terms` gives: (s, s2/m) for s x speed + s2/m x speed^2."""

    terms: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, braking: float, time_constant: float | None) -> Brakes:
        """braking: m/s2. time_constant: s. Without it `braking` alone is believed only where it is worse than
        `CAUTIOUS`: it was measured at one speed, and promises too much at lower ones."""
        quadratic = 1.0 / (2.0 * braking)
        if time_constant is None:
            return cls(((CAUTIOUS, 0.0), (0.0, quadratic)))
        return cls(((time_constant, quadratic),))

    def way(self, speed: float) -> float:
        """Metres to standstill from `speed` m/s."""
        return max(linear * speed + quadratic * speed**2 for linear, quadratic in self.terms)

    def fastest(self, metres: float, react: float) -> float:
        """The speed in m/s at which `react` seconds and the way to standstill take just so many metres."""
        return min(_root(quadratic, linear + react, max(0.0, metres)) for linear, quadratic in self.terms)


class Fit(NamedTuple):
    """time_constant: s. braking: m/s2. excess: the most that they promise above a measured way, its share."""

    time_constant: float
    braking: float
    excess: float


def fit(stops: Iterable[Measured]) -> Fit:
    """The figures that promise least and yet no less than any of these stops.

    Raises ValueError where the stops are too few or too much alike; its text says what to do.
    """
    found = [stop for stop in stops if stop.speed > 0.0 and stop.way > 0.0]
    speeds = [stop.speed for stop in found]
    if len(found) < 2 or max(speeds) < SPREAD * min(speeds):
        raise ValueError(
            f"{len(found)} HOLDs measured: brake at walking pace and at the fastest that it drives, at least "
            f"{SPREAD:g} times as fast"
        )
    # Metres a second of speed over speed is a straight line: the lowest that lies on or above all points.
    points = [(stop.speed, stop.way / stop.speed) for stop in found]
    least = 1.0 / (2.0 * MOST)
    flattest, steepest = max(y - least * v for v, y in points), max(y / v for v, y in points)
    lines = [(max(0.0, flattest), least), (0.0, max(least, steepest))]
    for (v1, y1), (v2, y2) in combinations(points, 2):
        if v1 != v2 and (slope := (y2 - y1) / (v2 - v1)) >= least and y1 - slope * v1 >= 0.0:
            lines.append((y1 - slope * v1, slope))
    above = [line for line in lines if all(line[0] + line[1] * v >= y - 1e-9 for v, y in points)]
    linear, slope = min(above, key=lambda line: sum((line[0] + line[1] * v) / y for v, y in points))
    # Rounded as they are written into a configuration, to the safe side.
    time_constant = math.ceil(100.0 * linear - 1e-6) / 100.0
    braking = max(0.01, math.floor(100.0 / (2.0 * slope) + 1e-6) / 100.0)
    return Fit(time_constant, braking, _excess(Brakes.of(braking, time_constant), found))


def _excess(brakes: Brakes, stops: Sequence[Measured]) -> float:
    return max(brakes.way(stop.speed) / stop.way - 1.0 for stop in stops)


def _root(quadratic: float, linear: float, metres: float) -> float:
    """The speed whose `linear` and `quadratic` ways are so many metres together."""
    if linear <= 0.0 and quadratic <= 0.0:
        return math.inf
    return 2.0 * metres / (linear + math.sqrt(linear**2 + 4.0 * quadratic * metres)) if metres else 0.0
