"""Calculates whether the vehicle stops before the things that its camera shows. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

from companion.config import Config

OVERSHOOT = 1.12
"""Actual speed by commanded speed. An ArduPilot with WP_SPEED 2 reached 2.25 m/s in simulation."""
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

    def fastest(self, metres: float, react: float) -> float:
        """Return the speed in m/s at which `react` seconds and the stop take `metres`."""
        return min(_root(quadratic, linear + react, max(0.0, metres)) for linear, quadratic in self.terms)


class Fit(NamedTuple):
    """Fitted figures. time_constant: s. braking: m/s2.

    excess: the largest share by which the fitted way is longer than a measured one.
    """

    time_constant: float
    braking: float
    excess: float


def fit(stops: Iterable[Measured]) -> Fit:
    """Fit the figures that give the shortest ways that are no shorter than any measured one.

    Raises ValueError where the stops are too few, or their speeds too similar; its text says what to do.
    """
    found = [stop for stop in stops if stop.speed > 0.0 and stop.way > 0.0]
    speeds = [stop.speed for stop in found]
    if len(found) < 2 or max(speeds) < SPREAD * min(speeds):
        raise ValueError(
            f"{len(found)} HOLDs measured: brake at walking pace and at the fastest that it drives, at least "
            f"{SPREAD:g} times as fast"
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
    return Fit(time_constant, braking, _excess(Brakes.of(braking, time_constant), found))


def _excess(brakes: Brakes, stops: Sequence[Measured]) -> float:
    return max(brakes.way(stop.speed) / stop.way - 1.0 for stop in stops)


def _root(quadratic: float, linear: float, metres: float) -> float:
    """Return the speed v at which linear * v + quadratic * v^2 = metres."""
    if linear <= 0.0 and quadratic <= 0.0:
        return math.inf
    return 2.0 * metres / (linear + math.sqrt(linear**2 + 4.0 * quadratic * metres)) if metres else 0.0


FARTHEST = 20.0
"""Metres. No thing counts as seen further ahead: near the horizon an image row gives too long a distance."""
WIDEST = 120.0
"""Degrees. A wider view does not follow the pinhole model."""
_SLOWEST = 0.05
_UNKNOWN_MEAN = 0.8
"""Mean uncertainty of a thing that no word explains."""


@dataclass(frozen=True)
class Outlook:
    """A camera on its vehicle, as a pinhole over level ground.

    height: m above the ground. tilt: degrees below the horizon. view: horizontal, degrees.
    aspect: width by height. front: m from the lens to the vehicle's front.
    """

    height: float
    tilt: float
    view: float
    aspect: float
    front: float = 0.0

    def distance(self, row: float) -> float:
        """Return the metres from the vehicle's front to where a row (0 top, 1 bottom) meets the ground.

        Infinite at the horizon and above it; never negative.
        """
        tilt, down = math.radians(self.tilt), (row - 0.5) / self._focal
        drop = math.sin(tilt) + down * math.cos(tilt)
        if drop <= 0:
            return math.inf
        ahead = math.cos(tilt) - down * math.sin(tilt)
        return max(0.0, self.height * ahead / drop - self.front)

    def row(self, distance: float) -> float:
        """Return the row that meets the ground at `distance` metres; outside [0, 1]: not in the image."""
        tilt, ahead = math.radians(self.tilt), distance + self.front
        across = self.height * math.cos(tilt) - ahead * math.sin(tilt)
        along = self.height * math.sin(tilt) + ahead * math.cos(tilt)
        return 0.5 + self._focal * across / along if along > 0 else math.inf

    @property
    def _focal(self) -> float:
        """The focal length in image heights."""
        return self.aspect / 2.0 / math.tan(math.radians(self.view / 2.0))


@dataclass(frozen=True)
class Stopping:
    """Whether the vehicle stops in time. Times are in s, distances in m from the vehicle's front.

    speed: commanded speed, m/s; it is assumed to drive `OVERSHOOT` times as fast. brakes: the way from HOLD
    to standstill. react: time from when a thing can be seen until the brakes act. sees: distance at which it
    can be seen. top: the ROI's upper side that would be enough at this speed, None where none would.
    overrun: distance that the autopilot's hold mode drives on; it is added to the braking distance.
    """

    speed: float
    brakes: Brakes
    react: float
    sees: float
    top: float | None = None
    overrun: float = 0.0

    @property
    def needs(self) -> float:
        """Metres to standstill from the moment that a thing can be seen."""
        return self.driven * self.react + self.brakes.way(self.driven) + self.overrun

    @property
    def driven(self) -> float:
        """The highest speed that it really drives, m/s."""
        return OVERSHOOT * self.speed

    @property
    def fits(self) -> float:
        """The highest commanded speed, m/s, at which the vehicle stops in time."""
        return self.brakes.fastest(self.sees - self.overrun, self.react) / OVERSHOOT

    @property
    def enough(self) -> bool:
        """Whether the vehicle stops before the thing."""
        return self.needs <= self.sees

    def describe(self) -> str:
        """Return the judgement as text and, where the vehicle does not stop in time, the remedies."""
        circling = f", then {self.overrun:g} m on in LOITER" if self.overrun else ""
        braked = self.brakes.way(self.driven)
        way = (
            f"at {self.speed:g} m/s it takes {self.needs:.1f} m to stop "
            f"({100 * (OVERSHOOT - 1):.0f} % of overshoot, {self.react:.1f} s to react, then {braked:.1f} m "
            f"in HOLD{circling}), and a thing is seen {self.sees:.1f} m ahead"
        )
        if self.enough:
            return f"{way}: fits up to {_down(self.fits):.2f} m/s"
        return f"{way}: {', or '.join(self._remedies())}"

    def _remedies(self) -> list[str]:
        slower, remedies = _down(self.fits), []
        if slower >= _SLOWEST:
            remedies.append(f"drive at most {slower:.2f} m/s")
        if self.top is not None:
            remedies.append(f"set [roi] top = {_down(self.top):.2f} (further up the picture)")
        if self.overrun:
            remedies.append('set [call] px4_hold = "offboard"')
        remedies.append("mount the camera higher or tilted less")
        remedies.append("judge more often (a quicker perceiver, [camera] rate, a smaller [call] freshness)")
        return remedies if slower >= _SLOWEST else [f"no speed is slow enough: {remedies[0]}", *remedies[1:]]


def judge_stopping(
    config: Config,
    step: float = 0.0,
    tile: float | None = None,
    speed: float | None = None,
    overrun: float = 0.0,
) -> Stopping | str:
    """Judge whether the configured vehicle stops in time; a text that says what to set where it cannot.

    step: seconds that the perceiver takes for a frame. tile: the worst tile's threshold in force, None where
    tiles are not judged. speed: m/s that the autopilot is known to drive; it counts where it is greater than
    the configured speed. overrun: as in `Stopping`, where the autopilot is known.

    The time to react is the sum of three: the camera's latency; the time until the thing is noticed; and the
    time until the command reaches the brakes. The second is the longer of two cases: a frame is judged and
    the reason debounced, or the vision process fails at that moment and T passes. Both at once are not
    assumed. T counts from the capture time that the camera reports, which does not include its latency.
    """
    mount, stopping, roi, call = config.mount, config.stopping, config.roi, config.call
    fastest = max((one for one in (stopping.speed, speed) if one is not None), default=None)
    if mount.height is None or mount.tilt is None or fastest is None:
        missing = ["[mount] height and tilt"] if mount.height is None or mount.tilt is None else []
        return f"set {', and '.join([*missing, *(['[stopping] speed'] if fastest is None else [])])}"
    if config.camera.view > WIDEST:
        return f"[camera] view is over {WIDEST:g} degrees, which is no pinhole's: measure on the ground"
    outlook = Outlook(mount.height, mount.tilt, config.camera.view, mount.aspect, mount.front)
    # A thing is noticed when it fills so much of a tile that the tile's mean passes its threshold.
    filled = min(1.0, tile / _UNKNOWN_MEAN) if tile is not None else 1.0
    rows = filled * roi.tile_share * (roi.right - roi.left) * mount.aspect
    sees = outlook.distance(min(roi.top + rows, roi.bottom))
    interval = max(step, 1.0 / config.camera.rate)
    noticed = max(step + call.window * interval, config.freshness)
    react = config.camera.latency + noticed + stopping.delay
    brakes = Brakes.of(stopping.braking, stopping.time_constant)
    judged = Stopping(fastest, brakes, react, min(sees, FARTHEST), overrun=overrun)
    top = outlook.row(judged.needs) - rows
    return replace(judged, top=top) if judged.needs <= FARTHEST and 0.0 <= top < roi.top else judged


def _down(figure: float) -> float:
    return math.floor(100 * figure) / 100
