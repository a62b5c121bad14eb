"""Tells a measured zone as a table, and what it means for the rover's stop. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from anytraverse.light import light_name
from companion.desk.check.zone_file import Zone, ZoneArc, ZoneLook, ZoneMark
from companion.desk.check.zone_plan import LineVerdict, WalkLine

_SLOWEST = 0.05
"""m/s. Below, no speed is slow enough."""


def light_text(look: ZoneLook) -> str:
    """Return the light of a mark in words."""
    if look.light is None:
        return "light not measured"
    name = light_name(look.light)
    return f"brightness {look.light.mean:.0f} of 255{f', {name}' if name else ''}"


def table(zone: Zone, verdicts: Sequence[LineVerdict]) -> Iterator[str]:
    """Yield the lines of a table: a row a line of marks, a column a distance, and the verdict of each."""
    yield f"{'':<11} {'bearing':>7} " + "".join(f"{one:>6g} m" for one in zone.distances)
    for judged in verdicts:
        line = judged.line
        marks = {one.distance_m: one for one in zone.marks if one.line == line.name}
        cells = "".join(f"{_cell(marks.get(one)):>8}" for one in zone.distances)
        yield f"{line.name:<11} {line.bearing:>6.1f}° {cells}   {_verdict_text(judged)}"
    yield "yes: it would stop the rover; a share: of the frames, which is too few; -: not measured"
    if any(_is_stray(one) for one in zone.marks):
        yield "?: something was noticed, but not the thing on the mark: it does not count"
    lights = {one.light.mean: light_text(one) for one in zone.marks if one.light is not None}
    if lights:
        yield f"light: from {lights[min(lights)]} to {lights[max(lights)]}"
    for arc in zone.arcs:
        yield _arc_text(arc, zone.mount.get("width"))


def _arc_text(arc: ZoneArc, width: float | None) -> str:
    span, way = arc.to_deg - arc.from_deg, ""
    if width is not None and span > 0.0 and arc.distance_m > 0.0:
        in_way = 2 * math.degrees(math.asin(min(1.0, width / 2 / arc.distance_m)))
        way = f"; the rover's way is {min(100.0, 100 * in_way / span):.0f} % of it"
    bearings = f"{arc.from_deg:.0f}° to {arc.to_deg:.0f}°"
    return f"arc at {arc.distance_m:g} m, {bearings}: noticed in {_share(arc)} of the frames{way}"


def _cell(mark: ZoneMark | None) -> str:
    if mark is None:
        return "-"
    return "yes" if mark.noticed else "?" if _is_stray(mark) else _share(mark)


def _is_stray(mark: ZoneMark) -> bool:
    return mark.noticed_frames > 0 and (mark.elsewhere or not mark.in_picture)


def _share(look: ZoneLook) -> str:
    return f"{100 * look.share:.0f} %"


def _verdict_text(found: LineVerdict) -> str:
    gaps = f", gaps at {', '.join(f'{one:g}' for one in found.gaps)} m" if found.gaps else ""
    nowhere = "not at the nearest mark" if found.gaps else "nowhere"
    reach = f"noticed to {found.noticed_to:g} m{gaps}" if found.noticed_to else f"noticed {nowhere}{gaps}"
    if found.beside:
        return f"{reach}; not in its way"
    if found.enough is None or found.needs is None:
        return reach
    where = "in its way up to" if found.needs == found.line.way else "needed to"
    return f"{reach}; {where} {found.needs:.1f} m: {'enough' if found.enough else 'TOO SHORT'}"


def conclusion(
    zone: Zone, lines: Sequence[WalkLine], verdicts: Sequence[LineVerdict]
) -> tuple[str, bool | None]:
    """Return whether the zone covers the stop, in words and as a flag; None: it is not known.

    lines: all that were planned. One in the rover's way that was not measured covers nothing.
    """
    speed, needs = zone.stop.get("speed"), zone.stop.get("needs")
    if speed is None or needs is None:
        return "it is not known whether that is enough: set [mount] and [stopping] speed", None
    at = f"at {speed:g} m/s it takes {needs:.1f} m to stop, without the autopilot's own overrun"
    in_way = [one for one in verdicts if one.enough is not None]
    fits = min((one.speed for one in in_way if one.speed is not None), default=None)
    short = [one.line.name for one in in_way if not one.enough]
    fastest = "" if fits is None or math.isinf(fits) else f"{math.floor(100 * fits) / 100:.2f} m/s"
    if short:
        remedy = "no speed is slow enough: mend the gaps nearest to the rover first"
        if fits is not None and fits >= _SLOWEST:
            remedy = f"measure again at {fastest} at most, or let it look further (row stopping)"
        return f"{at}: the zone is too short ({', '.join(short)}): {remedy}", False
    measured, nearest = {one.line.name for one in verdicts}, min(zone.distances, default=0.0)
    missing = [one.name for one in lines if one.name not in measured and one.in_way(nearest)]
    if missing or not in_way:
        return f"{at}: not known: measure {', '.join(missing) or 'what is in its way'}, too", None
    if any(one.way is None for one in lines):
        return f"{at}: straight ahead the zone covers that; set [mount] width to have its sides judged", None
    if zone.clear is not True:
        why = "look at the empty ground after the last mark, too"
        if zone.clear is False:
            why = "after the last mark the empty ground would stop it, too: measure again"
        return f"{at}: not known: {why}", None
    return f"{at}: the zone covers that{f', and up to {fastest}' if fastest else ''}", True
