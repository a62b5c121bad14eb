"""Collects the points of a plot, each measured several times."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from bench.ratios import spread

_ENOUGH = 20e-3
"""Seconds of CPU time that one measured run lasts at least: what is shorter is repeated within it."""
_MOST = 1000
_APART = 1.5
"""Least factor between two places of which `power` can be told."""
_BLOCKS = 8
_SETTLING = 0.2
"""Share of x that does not count for the slope: the memory of scenes and pictures fills meanwhile."""
_T_975 = {2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306}
"""Degrees of freedom -> Student's t of a 95 % interval."""


class Slope(NamedTuple):
    """A rise with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass
class PlottedSeries:
    """Holds lines over one axis. title: of the plot. x: what grows. unit: of the points.

    lines: name -> points [x, median, lower quartile, upper quartile].
    """

    title: str
    x: str
    unit: str
    lines: dict[str, list[list[float]]] = field(default_factory=dict)

    def add(self, line: str, x: float, values: Sequence[float]) -> None:
        """Adds a point, measured several times."""
        found = spread(values)
        point = [float(f"{value:.4g}") for value in (found.median, found.low, found.high)]
        self.lines.setdefault(line, []).append([x, *point])

    def as_json(self) -> dict[str, Any]:
        """Returns the values for the last line, with `power` of each line: cost grows as x ** power."""
        powers = {name: power(points) for name, points in self.lines.items()}
        return {**vars(self), "power": {name: value for name, value in powers.items() if value is not None}}


def power(points: Sequence[Sequence[float]]) -> float | None:
    """Returns p where the last two points are as x ** p: 0 flat, 1 linear, 2 quadratic.

    None where there are fewer, or where they are too near to tell.
    """
    if len(points) < 2 or min(points[-2][1], points[-1][1]) <= 0 or points[-1][0] < _APART * points[-2][0]:
        return None
    return round(float(np.log(points[-1][1] / points[-2][1]) / np.log(points[-1][0] / points[-2][0])), 2)


def slope(points: Sequence[Sequence[float]], over: float) -> Slope:
    """Returns the rise of the points' medians by blocks over so much of x, after the first fifth of it.

    Neighbouring samples resemble each other, medians of blocks hardly: so the interval is not too narrow.
    """
    places = np.array([point[0] for point in points])
    values = np.array([point[1] for point in points])
    settled = places > _SETTLING * places[-1]
    blocks = min(_BLOCKS, int(settled.sum()))
    x = np.array([part.mean() for part in np.array_split(places[settled], blocks)])
    y = np.array([np.median(part) for part in np.array_split(values[settled], blocks)])
    away = x - x.mean()
    rise = float(away @ y / (away @ away))
    rest = y - y.mean() - rise * away
    error = math.sqrt(float(rest @ rest) / (blocks - 2) / float(away @ away))
    half = _T_975[blocks - 2] * error
    low, value, high = (round(over * one, 3) for one in (rise - half, rise, rise + half))
    return Slope(value, low, high)


def cpu_ms(run: Callable[[], object], rounds: int) -> list[float]:
    """Returns the milliseconds of process CPU time that `run` takes, measured so often after a first time."""
    run()
    begin = time.process_time()
    run()
    took = time.process_time() - begin
    times = min(_MOST, max(1, round(_ENOUGH / max(took, 1e-6))))
    found = []
    for _ in range(rounds):
        begin = time.process_time()
        for _ in range(times):
            run()
        found.append((time.process_time() - begin) / times * 1e3)
    return found
