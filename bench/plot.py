"""Makes a plot of a series, for the page of results. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from anytraverse.plots import COLOURS, HINT, Axis, Curve, Plot, curves

_FEW = 10
"""Points of a line up to which each has a tick of its own."""
_FACTOR, _FACTOR_OF_FEW = 30.0, 8.0
"""Least factor between the ends of an axis that is logarithmic, and of one with few ticks of its own."""


def plot(series: Mapping[str, Any]) -> Plot | None:
    """Returns the lines of a series with their quartiles; None without a point."""
    lines: Mapping[str, Sequence[Sequence[float]]] = series["lines"]
    points = [point for line in lines.values() for point in line]
    if not points:
        return None
    own = sorted({point[0] for point in points})
    ticks = own if len(own) <= _FEW else None
    if ticks is None:  # samples
        across = Axis(series["x"], (min(0.0, own[0]), own[-1]))
    else:
        across = _axis(series["x"], own, _FACTOR_OF_FEW, ticks)
    up = _axis(series["unit"], [value for point in points for value in point[1:]], _FACTOR)
    drawn = [
        Curve(name, COLOURS[number % len(COLOURS)], [_point(*point) for point in line])
        for number, (name, line) in enumerate(lines.items())
    ]
    return curves(series["title"], f"Median and quartiles of each point. {HINT}", drawn, across, up)


def _point(x: float, median: float, low: float | None = None, high: float | None = None) -> dict[str, Any]:
    if low is None or high is None:
        return {"x": x, "y": median}
    return {"x": x, "y": median, "low": low, "high": high, "quartiles": f"{low:.3g} to {high:.3g}"}


def _axis(title: str, values: Sequence[float], factor: float, ticks: Sequence[float] | None = None) -> Axis:
    """Makes a logarithmic axis where values differ by this factor, else one from 0."""
    least, most = min(values), max(values)
    if least > 0 and most >= factor * least:
        return Axis(title, logarithmic=True, ticks=ticks)
    return Axis(title, (min(0.0, least), most if most > min(0.0, least) else 1.0), ticks=ticks)
