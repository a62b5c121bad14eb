"""The way from HOLD to standstill, and whether the vehicle stops before what its camera shows it. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

from companion.config import Config

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


FARTHEST = 20.0
"""Metres. Rows near the horizon promise more than level ground, lens and network keep."""
WIDEST = 120.0
"""Degrees: a wider view is no pinhole's."""
_SLOWEST = 0.05
_UNEXPLAINED = 0.8
"""Uncertainty of a thing without a word, on the mean of its pixels."""


@dataclass(frozen=True)
class Outlook:
    """A camera on its vehicle.

    height: m above the ground. tilt: degrees below the horizon. view: horizontal, degrees.
    aspect: width by height. front: m from the lens to the vehicle's front.
    """

    height: float
    tilt: float
    view: float
    aspect: float
    front: float = 0.0

    def distance(self, row: float) -> float:
        """Metres from the vehicle's front to where an image row (0 top, 1 bottom) meets the ground.

        Infinite at the horizon and above it; never negative.
        """
        tilt, down = math.radians(self.tilt), (row - 0.5) / self._focal
        drop = math.sin(tilt) + down * math.cos(tilt)
        if drop <= 0:
            return math.inf
        ahead = math.cos(tilt) - down * math.sin(tilt)
        return max(0.0, self.height * ahead / drop - self.front)

    def row(self, distance: float) -> float:
        """The image row, above 1 or below 0 where it is not in the image, that meets the ground there."""
        tilt, ahead = math.radians(self.tilt), distance + self.front
        across = self.height * math.cos(tilt) - ahead * math.sin(tilt)
        along = self.height * math.sin(tilt) + ahead * math.cos(tilt)
        return 0.5 + self._focal * across / along if along > 0 else math.inf

    @property
    def _focal(self) -> float:
        """Focal length in image heights."""
        return self.aspect / 2.0 / math.tan(math.radians(self.view / 2.0))


@dataclass(frozen=True)
class Stopping:
    """Times in s, distances in m from the vehicle's front.

    speed: m/s that it is told to drive; it is reckoned to drive `OVERSHOOT` times as fast. brakes: from HOLD
    to standstill. react: from the moment that a thing may be seen until they act. sees: where that is.
    top: the ROI's upper side that would be enough at this speed; None where none would.
    overrun: driven on in the autopilot's hold mode, taken to come on top of braking.
    """

    speed: float
    brakes: Brakes
    react: float
    sees: float
    top: float | None = None
    overrun: float = 0.0

    @property
    def needs(self) -> float:
        """The way to standstill from the moment that a thing may be seen."""
        return self.driven * self.react + self.brakes.way(self.driven) + self.overrun

    @property
    def driven(self) -> float:
        """m/s that it may really drive."""
        return OVERSHOOT * self.speed

    @property
    def fits(self) -> float:
        """The speed to be told whose way to standstill is just what is seen."""
        return self.brakes.fastest(self.sees - self.overrun, self.react) / OVERSHOOT

    @property
    def enough(self) -> bool:
        """Whether the vehicle stops before what it sees."""
        return self.needs <= self.sees

    def told(self) -> str:
        """The judgement and, where it is bad, what to do."""
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


def judge(
    config: Config,
    step: float = 0.0,
    tile: float | None = None,
    speed: float | None = None,
    overrun: float = 0.0,
) -> Stopping | str:
    """The judgement on what is configured, or why there is none and what to do.

    step: seconds that the perceiver takes for a frame. tile: the worst tile's threshold in force, None where
    tiles are not judged. speed: m/s that the autopilot is known to drive, which counts where it is greater
    than the configured one. overrun: as in `Stopping`, where the autopilot is known.

    Time to react: the camera's latency; then a frame is judged and the votes come in, or the eyes fail just
    then and T passes, whichever takes longer; then the order reaches the brakes. That both happen at once is
    not reckoned with. T counts from when a frame was captured, as far as the camera tells: its latency, which
    it does not tell, comes on top.
    """
    mount, stopping, roi, call = config.mount, config.stopping, config.roi, config.call
    fastest = max((one for one in (stopping.speed, speed) if one is not None), default=None)
    if mount.height is None or mount.tilt is None or fastest is None:
        missing = ["[mount] height and tilt"] if mount.height is None or mount.tilt is None else []
        return f"set {', and '.join([*missing, *(['[stopping] speed'] if fastest is None else [])])}"
    if config.camera.view > WIDEST:
        return f"[camera] view is over {WIDEST:g} degrees, which is no pinhole's: measure on the ground"
    outlook = Outlook(mount.height, mount.tilt, config.camera.view, mount.aspect, mount.front)
    filled = min(1.0, tile / _UNEXPLAINED) if tile is not None else 1.0
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
