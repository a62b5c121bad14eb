"""Draws lines and dots over two axes as SVG for a page of `html_page`. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

STYLE = """
svg { display: block; font-size: 12px; max-width: 100%; height: auto; }
svg text { fill: var(--faint); } svg .grid { stroke: var(--line); }
svg .mark { stroke: var(--grey); stroke-dasharray: 3 3; }
svg polyline { fill: none; stroke-width: 2; }
"""
TOP = 10
_LEFT, _BOTTOM = 38, 42
_NAMES = 64
_EDGE = 12
_TICKS = 5
_LINE = 14


class Series(NamedTuple):
    """Points (x, y) that belong together. colour: a variable of the page's style, e.g. "--green".

    dots: each point is a dot, and no line joins them. name: written beside the last dot, or at the right of
    the plot beside the end of the line; "" for none.
    """

    name: str
    colour: str
    points: Sequence[tuple[float, float]]
    dots: bool = False


Range = tuple[float, float]
Tick = tuple[float, str]
"""Where a number stands on an axis, from 0 to 1, and the number as text."""


class Axes(NamedTuple):
    """Two axes. size: their lengths in pixels. left, right: pixels beside them, for numbers and names."""

    size: tuple[int, int]
    left: int
    right: int

    def at(self, across: float, up: float) -> tuple[float, float]:
        """Return the pixel of a place, whose coordinates go from 0 to 1."""
        return self.left + across * self.size[0], TOP + (1.0 - up) * self.size[1]

    def drawn(self, title: str, label: str, across: Sequence[Tick], up: Sequence[Tick]) -> list[str]:
        """Return the begin of the SVG: its size, the grid, the numbers and the label of the x axis."""
        (width, height), left = self.size, self.left
        whole = left + width + self.right, TOP + height + _BOTTOM
        parts = [
            f'<svg viewBox="0 0 {whole[0]} {whole[1]}" width="{whole[0]}" role="img">',
            f"<title>{escape(title)}</title>",
        ]
        for share, number in up:
            at = self.at(0.0, share)[1]
            parts.append(f'<line class="grid" x1="{left}" y1="{at:.1f}" x2="{left + width}" y2="{at:.1f}"/>')
            parts.append(f'<text x="{left - 8}" y="{at + 4:.1f}" text-anchor="end">{number}</text>')
        parts += [
            f'<text x="{self.at(share, 0.0)[0]:.1f}" y="{TOP + height + 18}" text-anchor="middle">'
            f"{number}</text>"
            for share, number in across
        ]
        middle = left + width / 2
        parts.append(
            f'<text x="{middle}" y="{TOP + height + 36}" text-anchor="middle">{escape(label)}</text>'
        )
        return parts


def line_plot(
    series: Sequence[Series],
    label: str,
    *,
    x: Range = (0.0, 1.0),
    y: Range = (0.0, 1.0),
    mark: float | None = None,
    size: tuple[int, int] = (440, 280),
) -> str:
    """Return the SVG. label: of the x axis. mark: an x at which a line stands. size: of the axes, pixels.

    x, y: the least and the greatest value that are shown; points outside are drawn at the edge.
    """
    width, height = size
    beside = any(one.name and not one.dots for one in series)
    axes = Axes(size, _LEFT, _NAMES if beside else _EDGE)
    names = ", ".join(one.name for one in series if one.name)
    numbers = (
        [(_share(value, x), _number(value, x)) for value in ticks(x)],
        [(_share(value, y), _number(value, y)) for value in ticks(y)],
    )
    parts = axes.drawn(f"{names} over {label}", label, *numbers)

    def across(value: float) -> float:
        return axes.at(_share(value, x), 0.0)[0]

    def down(value: float) -> float:
        return axes.at(0.0, _share(value, y))[1]

    if mark is not None:
        at = f"{across(mark):.1f}"
        parts.append(f'<line class="mark" x1="{at}" y1="{TOP}" x2="{at}" y2="{TOP + height}"/>')
    for one in series:
        places = [(across(along), down(up)) for along, up in one.points]
        if one.dots:
            parts += [
                f'<circle cx="{along:.1f}" cy="{up:.1f}" r="3" style="fill:var({one.colour})"/>'
                for along, up in places
            ]
        elif places:
            line = " ".join(f"{along:.1f},{up:.1f}" for along, up in places)
            parts.append(f'<polyline points="{line}" style="stroke:var({one.colour})"/>')
    named = [
        (one, across(one.points[-1][0]), down(one.points[-1][1])) for one in series if one.points and one.name
    ]
    ends = sorted((up, one.name, one.colour) for one, _, up in named if not one.dots)
    dots = sorted((up, along, one.name, one.colour) for one, along, up in named if one.dots)
    parts += _names(ends, _LEFT + width + 6, TOP + height)
    parts += _names_at_dots(dots, _LEFT + width / 2, TOP + height)
    return "".join(parts) + "</svg>"


def ticks(span: Range) -> list[float]:
    """Return round numbers within a range, some five of them."""
    low, high = span
    if not high > low:
        return [low]
    step = round_step((high - low) / _TICKS * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [number * step for number in range(first, math.floor(high / step + 1e-9) + 1)]


def round_step(least: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is at least so much, above 0."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= least * (1 - 1e-9))


def _share(value: float, span: Range) -> float:
    low, high = span
    return min(1.0, max(0.0, (value - low) / (high - low))) if high > low else 0.0


def _number(value: float, span: Range) -> str:
    decimals = max(0, 1 - math.floor(math.log10(max(span[1] - span[0], 1e-9))))
    return f"{value:.{decimals if span[1] - span[0] < 5 else 0}f}"


def _names(ends: Sequence[tuple[float, str, str]], left: float, lowest: float) -> list[str]:
    """Write the names beside the ends of their lines. Those that would overlap are moved apart."""
    places = _apart([end for end, _, _ in ends], lowest)
    return [
        f'<text x="{left}" y="{place:.1f}" style="fill:var({colour})">{escape(name)}</text>'
        for place, (_, name, colour) in zip(places, ends, strict=True)
    ]


def _names_at_dots(dots: Sequence[tuple[float, float, str, str]], middle: float, lowest: float) -> list[str]:
    """Write the names beside their dots, to the left of those right of the middle."""
    parts = []
    for place, (_, along, name, colour) in zip(_apart([dot[0] for dot in dots], lowest), dots, strict=True):
        right = along > middle
        parts.append(
            f'<text x="{along + (-8 if right else 8):.1f}" y="{place:.1f}" '
            f'text-anchor="{"end" if right else "start"}" style="fill:var({colour})">{escape(name)}</text>'
        )
    return parts


def _apart(middles: Sequence[float], lowest: float) -> list[float]:
    """Return base lines for texts beside these heights, which rise, at least a line apart."""
    places: list[float] = []
    for middle in middles:
        places.append(max(middle + 4, places[-1] + _LINE if places else 0.0))
    moved = max(0.0, places[-1] - lowest) if places else 0.0
    return [place - moved for place in places]
