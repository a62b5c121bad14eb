"""Makes the simulated trail's route: a closed loop through meadow, forest and gravel to the meadow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ZONES = ("meadow", "forest", "gravel")
MIN_RADIUS = 12.0  # m, radius of the tightest bend
SHORTEST = 124.0  # m, the lap on which it is so tight
START = 14.0  # m after the border from gravel to meadow, so that a lap ends by returning to the meadow
MEADOW = 48.0  # m of a lap in the meadow; forest and gravel share the rest
BLEND = 7.0  # m over which one zone becomes the next
STEP = 0.1  # m between the stored points


@dataclass(frozen=True)
class TrailPose:
    """A place and direction: x and y in metres, heading in radians (0 = +x, counterclockwise)."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class Course:
    """How a loop is bent, and how wide its path is.

    half: half the path's width in m, which along the path is up to 0.15 m more or less. bends: how far the
    second and each further harmonic bends a circle, as shares of its radius, at most. tightest: radius in m
    of the tightest bend on a lap of `SHORTEST`; on a longer one it is as much larger.
    """

    half: float = 1.45
    bends: tuple[float, ...] = (0.16, 0.1, 0.03)
    tightest: float = MIN_RADIUS


LOOP = Course()


class Trail:
    """A loop of 124-138 m, driven counterclockwise; the same seed gives the same loop.

    Positions along it are s in metres, taken modulo `length`; s = 0 is the border from gravel to meadow.
    """

    def __init__(self, seed: int, length: float | None = None, course: Course = LOOP) -> None:
        """length: of a longer loop in metres, of which each zone has a third."""
        rng = np.random.default_rng([seed, 1])
        points = _loop(rng, course)
        count = round((float(rng.uniform(124.0, 138.0)) if length is None else length) / STEP)
        closed = np.vstack([points, points[:1]])
        run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
        closed *= count * STEP / run[-1]
        run *= count * STEP / run[-1]
        stations = np.arange(count) * STEP
        self._points = np.stack([np.interp(stations, run, closed[:, axis]) for axis in (0, 1)], axis=1)
        ahead = np.roll(self._points, -1, axis=0) - np.roll(self._points, 1, axis=0)
        self._headings = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        self.length = count * STEP
        self.course = course
        self.start = START
        meadow = MEADOW if length is None else self.length / 3
        forest_end = meadow + (self.length - meadow) / 2
        self.borders = {
            "meadow": (0.0, meadow),
            "forest": (meadow, forest_end),
            "gravel": (forest_end, self.length),
        }

    @property
    def points(self) -> NDArray[np.float64]:
        """The centre line (N, 2) in metres, one point every 0.1 m from s = 0."""
        return self._points

    def pose(self, s: float) -> TrailPose:
        """Returns the pose on the centre line at s, looking along the route."""
        at = (s % self.length) / STEP
        i, part = int(at) % len(self._points), at - int(at)
        j = (i + 1) % len(self._points)
        x, y = self._points[i] * (1 - part) + self._points[j] * part
        turn = math.remainder(float(self._headings[j] - self._headings[i]), 2 * math.pi)
        return TrailPose(
            float(x), float(y), math.remainder(float(self._headings[i]) + turn * part, 2 * math.pi)
        )

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Returns the nearest place on the centre line as (s, lateral offset), in metres, left positive."""
        dx, dy = x - self._points[:, 0], y - self._points[:, 1]
        i = int(np.argmin(dx * dx + dy * dy))
        c, s = math.cos(self._headings[i]), math.sin(self._headings[i])
        along, lateral = dx[i] * c + dy[i] * s, dy[i] * c - dx[i] * s
        return float((i * STEP + along) % self.length), float(lateral)

    def zone(self, s: float) -> str:
        """Returns the zone at s: "meadow", "forest" or "gravel"."""
        s %= self.length
        return next((zone for zone, (begin, end) in self.borders.items() if begin <= s < end), ZONES[0])

    def shares(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the share of each zone at s: (..., 3) in the order of ZONES, summing to 1."""
        shares = []
        for begin, end in self.borders.values():
            middle, half = (begin + end) / 2, (end - begin) / 2
            away = np.abs((s - middle + self.length / 2) % self.length - self.length / 2)
            ramp = np.clip((half - away) / BLEND + 0.5, 0.0, 1.0)
            shares.append(ramp * ramp * (3 - 2 * ramp))
        return np.stack(shares, axis=-1)

    def half_width(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns half the width of the path at s, in metres: 1.3 to 1.6 by default."""
        return self.course.half + 0.1 * np.sin(s * 0.45) + 0.05 * np.sin(s * 1.13 + 1.0)


def _loop(rng: np.random.Generator, course: Course) -> NDArray[np.float64]:
    """Makes a circle of unit scale, bent by harmonics as the tightest bend allows on the shortest lap."""
    count = len(course.bends)
    angle = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    phases = rng.uniform(0, 2 * np.pi, count)
    strength = rng.uniform(0.7, 1.0, count) * course.bends
    while True:
        radius = 1 + sum(
            a * np.cos(n * angle + p) for n, a, p in zip(range(2, 2 + count), strength, phases, strict=True)
        )
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        first = (np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)) / 2
        second = np.roll(points, -1, axis=0) + np.roll(points, 1, axis=0) - 2 * points
        speed = np.hypot(*first.T)
        bend = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
        if SHORTEST / speed.sum() / bend.max() >= course.tightest:
            return points
        strength = strength * 0.95
