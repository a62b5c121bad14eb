"""Models how the vehicle stops after HOLD, or once it begins to brake, and fits that to measured stops."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

CAUTIOUS = 2.1
"""Time constant in seconds where none is configured. None of the stops in `ARDUPILOT` took more."""
MOST = 100.0
"""m/s2. Highest deceleration of a fit; its share of the stopping distance is next to nothing."""
SPREAD = 1.5
"""The fastest stop must be this many times as fast as the slowest, or two figures cannot be fitted."""


class Measured(NamedTuple):
    """One measured stop. speed: m/s when HOLD was set. way: metres from there to standstill."""

    speed: float
    way: float


ARDUPILOT = tuple(
    Measured(*pair)
    for pair in ((0.61, 1.0), (0.88, 1.5), (1.35, 2.5), (1.84, 3.5), (2.83, 5.6), (3.84, 7.8), (4.85, 10.0))
)
"""Stops by HOLD from a steady speed, measured with ArduPilot Rover 4.7-dev in its own simulation."""


@dataclass(frozen=True)
class Brakes:
    """A model of the stopping distance after HOLD.

    Each of `terms` is (a in s, b in s2/m) and gives a * speed + b * speed^2 metres. The longest counts.
    """

    terms: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, braking: float, time_constant: float | None) -> Brakes:
        """Make the model of the configured figures. braking: m/s2. time_constant: s, None if not configured.

        A `braking` that was measured at one speed promises too much at lower speeds. So without a time
        constant it counts only where it gives a longer way than `CAUTIOUS`.
        """
        quadratic = 1.0 / (2.0 * braking)
        if time_constant is None:
            return cls(((CAUTIOUS, 0.0), (0.0, quadratic)))
        return cls(((time_constant, quadratic),))

    def way(self, speed: float) -> float:
        """Return the metres to standstill from `speed` m/s."""
        return max(linear * speed + quadratic * speed**2 for linear, quadratic in self.terms)

    def seconds(self, speed: float, until: float) -> float:
        """Return the seconds in which it gets from `speed` down to `until` m/s."""
        return max(
            linear * math.log(speed / until) + 2.0 * quadratic * (speed - until)
            for linear, quadratic in self.terms
        )

    def left(self, speed: float, seconds: float, least: float) -> float:
        """Return the speed in m/s after so many seconds of braking from `speed`, at least `least`."""
        low, high = least, max(speed, least)
        for _ in range(30):
            middle = (low + high) / 2.0
            low, high = (middle, high) if self.seconds(speed, middle) > seconds else (low, middle)
        return high

    def fastest(self, metres: float, react: float) -> float:
        """Return the speed in m/s at which `react` seconds and the stop take `metres`."""
        return min(_root(quadratic, linear + react, max(0.0, metres)) for linear, quadratic in self.terms)


class BrakeFit(NamedTuple):
    """Fitted figures. time_constant: s. braking: m/s2.

    excess: the largest share by which the fitted way is longer than a measured one.
    """

    time_constant: float
    braking: float
    excess: float


def fit(stops: Iterable[Measured], name: str = "HOLD") -> BrakeFit:
    """Fit the figures that give the shortest ways that are no shorter than any measured one.

    name: of the mode that stops. Raises ValueError where the stops are too few, or their speeds too similar;
    its text says what to do.
    """
    found = [stop for stop in stops if stop.speed > 0.0 and stop.way > 0.0]
    speeds = [stop.speed for stop in found]
    if len(found) < 2 or max(speeds) < SPREAD * min(speeds):
        raise ValueError(
            f"{len(found)} {name}s measured: brake at walking pace and at the fastest that it drives, at "
            f"least {SPREAD:g} times as fast"
        )
    # way / speed = time_constant + slope * speed: a straight line over speed. Find the lowest line that lies
    # on or above all points; it goes through one or two of them.
    points = [(stop.speed, stop.way / stop.speed) for stop in found]
    least = 1.0 / (2.0 * MOST)
    flattest, steepest = max(y - least * v for v, y in points), max(y / v for v, y in points)
    lines = [(max(0.0, flattest), least), (0.0, max(least, steepest))]
    for (v1, y1), (v2, y2) in combinations(points, 2):
        if v1 != v2 and (slope := (y2 - y1) / (v2 - v1)) >= least and y1 - slope * v1 >= 0.0:
            lines.append((y1 - slope * v1, slope))
    above = [line for line in lines if all(line[0] + line[1] * v >= y - 1e-9 for v, y in points)]
    linear, slope = min(above, key=lambda line: sum((line[0] + line[1] * v) / y for v, y in points))
    # Rounded to two digits, as they are written into a configuration, and to the safe side.
    time_constant = math.ceil(100.0 * linear - 1e-6) / 100.0
    braking = max(0.01, math.floor(100.0 / (2.0 * slope) + 1e-6) / 100.0)
    return BrakeFit(time_constant, braking, _excess(Brakes.of(braking, time_constant), found))


def _excess(brakes: Brakes, stops: Sequence[Measured]) -> float:
    return max(brakes.way(stop.speed) / stop.way - 1.0 for stop in stops)


def _root(quadratic: float, linear: float, metres: float) -> float:
    """Return the speed v at which linear * v + quadratic * v^2 = metres."""
    if linear <= 0.0 and quadratic <= 0.0:
        return math.inf
    return 2.0 * metres / (linear + math.sqrt(linear**2 + 4.0 * quadratic * metres)) if metres else 0.0
