"""Plans where a person stands with a thing, and judges what the marks say of the rover's way. Pure.

Distances are in m from the middle of the vehicle's front, bearings in degrees clockwise from its nose.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile
from typing import NamedTuple

from companion.config import Config
from companion.config.stopping import Stopping
from companion.desk.check.zone_file import MOST_MARKS, ZoneMark

DISTANCES = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 15.0, 20.0)
_SAME = 0.3
"""m by which two marks differ at least."""
_IN_VIEW = 0.9
"""Share of half of the view at which the outermost lines run, so that a thing on them is in the picture."""
_TYPED = re.compile(r"[0-9]{1,3}([.,][0-9]{1,2})?", re.ASCII)
_NEAREST, _FARTHEST = 0.1, 100.0
"""m of distances that may be typed."""
_STEP = 2.0
"""By this factor a mark may be farther than the one before it for the speed to rest on it."""
_SPARE = 1e-6
"""m that a comparison allows for rounding."""
_ROUNDED = 1.02
"""By this factor a line may leave the rover's way too early: its bearing is rounded."""


class WalkLine(NamedTuple):
    """A line on the ground. way: m for which it is in the rover's way straight ahead, None: not known."""

    name: str
    bearing: float
    way: float | None

    def point(self, distance: float) -> tuple[float, float]:
        """Return the metres ahead and to the right of the middle of the vehicle's front."""
        at = math.radians(self.bearing)
        return distance * math.cos(at), distance * math.sin(at)

    def needs(self, ahead: float) -> float:
        """Return the metres along the line of what is so many metres ahead."""
        return ahead / max(self.point(1.0)[0], 1e-6)

    def in_way(self, distance: float) -> bool:
        """Whether a mark of the line is known to be in the rover's way."""
        return self.way is not None and distance <= self.way * _ROUNDED


def walk_lines(config: Config, needs: float | None) -> tuple[WalkLine, ...]:
    """Return the lines from left to right: the picture's edges, the sides of the rover's way, and ahead.

    needs: metres in which the rover stops; there the sides of its way are as wide apart as the vehicle. None,
    or a vehicle of unknown width: a third of the view in their place.
    """
    heading, half, width = config.mount.heading, config.camera.view / 2, config.mount.width
    edge = min(_IN_VIEW * half, 85.0)
    beside = half / 3
    if width is not None and needs is not None:
        beside = min(edge / 2, math.degrees(math.asin(min(1.0, width / 2 / needs))))
    middle = 0.0 if abs(heading) < half / 3 else heading
    named = (
        ("left edge", heading - edge),
        ("left side", middle - beside),
        ("ahead", middle),
        ("right side", middle + beside),
        ("right edge", heading + edge),
    )
    return tuple(WalkLine(name, round(math.remainder(at, 360.0), 1), _way(at, width)) for name, at in named)


def _way(bearing: float, width: float | None) -> float | None:
    bearing = round(bearing, 1)
    if bearing == 0.0:
        return math.inf
    if width is None:
        return None
    return width / 2 / math.sin(math.radians(abs(bearing))) if abs(bearing) < 90.0 else 0.0


def walk_distances(
    lines: Sequence[WalkLine], needs: float | None, near: float | None, far: float | None
) -> tuple[float, ...]:
    """Return the marks' distances on a line, nearest first.

    needs: as of `walk_lines`; one mark is there on each line in the rover's way. near, far: between them the
    region of interest is; one mark is beyond. None: not known.
    """
    if needs is not None:
        needs = _needed_mark(lines, needs)
    reach = max((one for one in (needs, far) if one is not None), default=None)
    least = 0.0 if near is None else near
    found = [one for one in DISTANCES if one >= least]
    if reach is not None:
        found = [one for one in found if one <= reach] + [one for one in found if one > reach + _SAME][:1]
    if needs is not None:
        found = [one for one in found if abs(one - needs) >= _SAME] + [needs]
    return tuple(sorted(found))


def _needed_mark(lines: Sequence[WalkLine], needs: float) -> float:
    """Return the distance at which a thing on any line in the rover's way must be noticed."""
    farthest = max([needs, *(one.needs(needs) for one in lines if one.in_way(needs))])
    return math.ceil(farthest * 10 - 1e-6) / 10


def typed_distances(text: str, lines: Sequence[WalkLine], needs: float | None) -> tuple[float, ...]:
    """Read distances with spaces or ";" between, nearest first; () where they are none. 1,5 is 1.5.

    lines, needs: as of `walk_distances`; the mark that stopping needs is added.
    """
    found = [one.removesuffix(",") for one in text.replace(";", " ").split()]
    if not found or len(found) >= MOST_MARKS // 10 or not all(map(_TYPED.fullmatch, found)):
        return ()
    metres = {float(one.replace(",", ".")) for one in found}
    if min(metres) < _NEAREST or max(metres) > _FARTHEST:
        return ()
    return tuple(sorted(metres | (set() if needs is None else {_needed_mark(lines, needs)})))


@dataclass(frozen=True)
class LineVerdict:
    """What the marks of a line say.

    noticed_to: the farthest mark from which on inwards each mark was noticed, m, 0: not even the nearest.
    gaps: marks that were not noticed or not measured, nearer than one that was noticed. beside: whether the
    line leaves the rover's way before its nearest mark. needs: metres in which the thing must be noticed for
    the rover to stop, None: not known, or beside. enough: whether it is, None: not known, or beside.
    speed: m/s up to which it is, None: not known, or not a matter of the speed.
    """

    line: WalkLine
    noticed_to: float
    gaps: tuple[float, ...]
    beside: bool = False
    needs: float | None = None
    enough: bool | None = None
    speed: float | None = None


def verdicts(
    lines: Iterable[WalkLine],
    marks: Sequence[ZoneMark],
    distances: Sequence[float],
    stopping: Stopping | None,
) -> list[LineVerdict]:
    """Judge the lines of which any mark was measured. Another mark of these counts as not noticed.

    distances: of the planned marks. stopping: at the configured speed, None: not known.
    """
    measured = {one.line for one in marks}
    return [_verdict(line, marks, distances, stopping) for line in lines if line.name in measured]


def _verdict(
    line: WalkLine, marks: Iterable[ZoneMark], distances: Sequence[float], stopping: Stopping | None
) -> LineVerdict:
    noticed = {one.distance_m: one.noticed for one in marks if one.line == line.name}
    ordered = sorted({*distances, *noticed})
    inner = list(takewhile(noticed.get, ordered))
    outermost = max((one for one in ordered if noticed.get(one)), default=0.0)
    gaps = tuple(one for one in ordered if not noticed.get(one) and one < outermost)
    found = LineVerdict(line, inner[-1] if inner else 0.0, gaps)
    if stopping is None or line.way is None:
        return found
    needs = line.needs(stopping.needs)
    if not line.in_way(needs):
        in_way = [bool(noticed.get(one)) for one in ordered if line.in_way(one)]
        return replace(found, needs=line.way, enough=all(in_way)) if in_way else replace(found, beside=True)
    # Between marks far apart, beyond what this speed needs, nobody looked: no higher speed rests on them.
    sure = next(
        (one for one, after in pairwise(inner) if one >= needs and after > _STEP * one), found.noticed_to
    )
    sees, fits = (replace(stopping, sees=line.point(at)[0] + _SPARE) for at in (found.noticed_to, sure))
    return replace(found, needs=needs, enough=sees.enough, speed=max(0.0, fits.fits))
