"""Draws series as SVG, which a page holds. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

from anytraverse import line_plot

STYLE = f"""{line_plot.STYLE}
svg .spread {{ fill: none; stroke-width: 2; }}
.key {{ display: inline-block; width: .8em; height: .8em; border-radius: 2px; margin-right: .35em; }}
.legend span {{ margin-right: 1.2rem; white-space: nowrap; }}
"""
_COLOURS = ("--green", "--blue", "--red", "--violet", "--grey", "--faint", "--ink")
_AXES = line_plot.Axes((500, 260), left=56, right=40)
_FEW = 10
"""Points of a line up to which each has a tick of its own."""
_FACTOR, _FACTOR_OF_FEW = 30.0, 8.0
"""Least factor between the ends of an axis that is logarithmic, and of one with few ticks of its own."""


class _Axis(NamedTuple):
    """Places values from 0 to 1. ticks: the values that are written."""

    place: Callable[[float], float]
    ticks: tuple[float, ...]


def plot(series: Mapping[str, Any]) -> str:
    """Draws the lines of a series with their quartiles, and a legend."""
    lines: Mapping[str, Sequence[Sequence[float]]] = series["lines"]
    points = [point for line in lines.values() for point in line]
    if not points:
        return ""
    across = _axis([point[0] for point in points], own_ticks=True)
    up = _axis([value for point in points for value in point[1:]], own_ticks=False)

    def at(x: float, y: float) -> tuple[float, float]:
        return _AXES.at(across.place(x), up.place(y))

    label = f"{series['unit']} over {series['x']}"
    numbers = ([(axis.place(tick), _short(tick)) for tick in axis.ticks] for axis in (across, up))
    parts = _AXES.drawn(f"{series['title']}: {label}", label, *numbers)
    for number, line in enumerate(lines.values()):
        colour = f'style="stroke:var({_colour(number)})"'
        for x, _, low, high in line:
            if high > low:
                (left, bottom), (_, top) = at(x, low), at(x, high)
                parts.append(f'<path class="spread" d="M{left:.1f} {bottom:.1f}V{top:.1f}" {colour}/>')
        drawn = " ".join("{:.1f},{:.1f}".format(*at(x, value)) for x, value, *_ in line)
        parts.append(f'<polyline points="{drawn}" {colour}/>')
    return "".join(parts) + "</svg>" + _legend(list(lines))


def _legend(names: Sequence[str]) -> str:
    marks = (
        f'<span><i class="key" style="background:var({_colour(number)})"></i>{escape(name)}</span>'
        for number, name in enumerate(names)
    )
    return f'<p class="legend faint">{" ".join(marks)}</p>'


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _axis(values: Sequence[float], *, own_ticks: bool) -> _Axis:
    """Makes a logarithmic axis where values differ much, else one from 0.

    own_ticks: each of few values has one; many are samples, and lie on an axis from 0.
    """
    least, most = min(values), max(values)
    own = tuple(sorted(set(values))) if own_ticks and len(set(values)) <= _FEW else ()
    factor = _FACTOR_OF_FEW if own else math.inf if own_ticks else _FACTOR
    if least > 0 and most >= factor * least:
        low, high = math.log10(least), math.log10(most)
        if not own:
            low, high = math.floor(low), math.ceil(high)
        decades = tuple(10.0**power for power in range(math.ceil(low), math.floor(high) + 1))
        return _Axis(lambda value: (math.log10(value) - low) / (high - low), own or decades)
    bottom, top = min(0.0, least), most if most > min(0.0, least) else 1.0
    step = line_plot.round_step((top - bottom) / 5)
    first, last = math.floor(bottom / step), math.ceil(top / step - 1e-9)
    ticks = tuple(number * step for number in range(first, last + 1))
    return _Axis(lambda value: (value - ticks[0]) / (ticks[-1] - ticks[0]), own or ticks)


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
