"""Draws a measured zone from above as SVG, the rover at the foot. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from companion.desk.check.zone_file import Zone
from companion.desk.check.zone_plan import WalkLine

_NOTICED, _MISSED, _OPEN, _FAINT = "#009e73", "#d55e00", "#8a929b", "#c9ced4"
"""Colours: a mark that was noticed, not noticed, not measured; rings and the rover."""
_HIGH, _EDGE, _NARROWEST = 640.0, 60.0, 480.0
"""Pixels: the picture's height, what is beside the outermost marks, and the least width."""


def picture(zone: Zone, lines: Sequence[WalkLine]) -> str:
    """Return the SVG: a dot a mark, a ring a distance, and dashed how far the rover needs to stop."""
    points = [(line, one, *line.point(one)) for line in lines for one in zone.distances]
    far = max((ahead for *_, ahead, _ in points), default=1.0)
    aside = max((abs(right) for *_, right in points), default=1.0)
    scale = (_HIGH - 2 * _EDGE) / max(far, 0.1)
    wide, foot = max(_NARROWEST, 2 * (_EDGE + aside * scale)), _HIGH - _EDGE
    middle, width = wide / 2, zone.mount.get("width") or 0.4
    front = f'x="{middle - width / 2 * scale:.1f}" y="{foot:.1f}" width="{width * scale:.1f}"'
    parts = [
        f'<rect width="{wide:.0f}" height="{_HIGH:.0f}" fill="#fff"/>',
        f'<rect {front} height="{_EDGE - 8:.0f}" rx="6" fill="{_FAINT}"/>',
    ]
    for one in zone.distances:
        parts.append(_ring(middle, foot, one * scale, _FAINT))
        parts.append(_text(middle + 10, foot - one * scale - 6, f"{one:g} m"))
    needs = zone.stop.get("needs")
    if needs is not None:
        parts.append(_ring(middle, foot, needs * scale, _MISSED, ' stroke-dasharray="6 5"'))
    marks = {(one.line, one.distance_m): one for one in zone.marks}
    for line, distance, ahead, right in points:
        mark = marks.get((line.name, distance))
        colour = _OPEN if mark is None else _NOTICED if mark.noticed else _MISSED
        parts.append(
            f'<circle cx="{middle + right * scale:.1f}" cy="{foot - ahead * scale:.1f}" r="6" '
            f'fill="{"#fff" if mark is None else colour}" stroke="{colour}" stroke-width="2">'
            f"<title>{escape(line.name)}, {distance:g} m</title></circle>"
        )
    stops = "" if needs is None else f"; dashed: it stops in {needs:.1f} m"
    parts.append(_text(10, 20, f"{zone.at} {zone.thing}"))
    parts.append(_text(10, 38, f"green: noticed, orange: not, empty: not measured{stops}"))
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.0f} {_HIGH:.0f}"'
    return "\n".join([f'{head} font-family="sans-serif" font-size="12">', *parts, "</svg>\n"])


def _ring(x: float, y: float, radius: float, colour: str, more: str = "") -> str:
    """Return the upper half of a circle."""
    path = f"M {x - radius:.1f} {y:.1f} A {radius:.1f} {radius:.1f} 0 0 1 {x + radius:.1f} {y:.1f}"
    return f'<path d="{path}" fill="none" stroke="{colour}"{more}/>'


def _text(x: float, y: float, text: str) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}">{escape(text)}</text>'
