"""Defines what a plan is: two arcs over ground that is known to be drivable. In m, and angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from anytraverse.frame import Pose

Point = tuple[float, float]
_SHORT = 0.01
"""m: a shorter piece of a way has no direction."""


class Route(NamedTuple):
    """The way that the mission drives, as a polyline by odometry.

    points: (x, y) in m, from a point behind the vehicle or beside it onwards; at least two. corridor: m to
    each side of it that the vehicle may leave it by.
    """

    points: tuple[Point, ...]
    corridor: float

    def at(self, pose: Pose) -> tuple[float, float]:
        """Return where it leads beside a pose, in degrees counter-clockwise, and how much is left of it."""
        foot, rest = ahead(self.points, pose)
        onwards = list(pairwise([foot, *rest]))
        left = sum(math.dist(*leg) for leg in onwards)
        legs = onwards if left > _SHORT else reversed(list(pairwise(self.points)))
        x, y = next((b[0] - a[0], b[1] - a[1]) for a, b in legs if math.dist(a, b) > min(_SHORT, left / 2))
        return math.degrees(math.atan2(y, x)), left


def ahead(points: Sequence[Point], pose: Pose) -> tuple[Point, Sequence[Point]]:
    """Return the point of a polyline that a vehicle is beside, and the corners from there on.

    It is the nearest one from the polyline's begin up to where that leads away from the vehicle, or turns
    back beyond it: a lane on which it comes back is not reached yet. Raises ValueError without two points
    that differ.
    """
    found, nearest, part, before = None, math.inf, 1.0, (0.0, 0.0)
    for number, (start, end) in enumerate(pairwise(points)):
        leg = end[0] - start[0], end[1] - start[1]
        squared = leg[0] ** 2 + leg[1] ** 2
        if not squared:
            continue
        if part < 1.0 and leg[0] * before[0] + leg[1] * before[1] < 0.0:
            break
        part, before = ((pose.x - start[0]) * leg[0] + (pose.y - start[1]) * leg[1]) / squared, leg
        part = max(0.0, min(1.0, part))
        foot = end if part == 1.0 else (start[0] + leg[0] * part, start[1] + leg[1] * part)
        away = math.hypot(pose.x - foot[0], pose.y - foot[1])
        if away > nearest:
            break
        found, nearest = (foot, points[number + 1 :]), away
    if found is None:
        raise ValueError("a way needs two points that differ")
    return found


class Outline(NamedTuple):
    """What of the vehicle's shape planning needs, in m.

    width: its width. front: from the lens forward to its front. radius: of its tightest turn.
    """

    width: float
    front: float
    radius: float


class Errand(NamedTuple):
    """What plans are made for. far: m over which a way should be clear: a longer one is no better."""

    route: Route
    outline: Outline
    far: float


class Plan(NamedTuple):
    """What was planned when a frame had been marked in the grid.

    at: the frame's capture, monotonic s. pose: of the vehicle then, where the arcs begin.
    route_clear: m from the vehicle's front along the mission's way to the first ground, over the vehicle's
    width and margins, that is not known to be drivable; where all that can be seen is, how far that is.
    route_blocked: that ground is known not to be drivable; otherwise it was not seen yet.
    arcs: curvature in 1/m (positive to the left) and length in m of each arc; empty where no way was found.
    clear: m from the vehicle's front along the arcs over which all of it is known to be drivable; 0 without.
    gap: m from the vehicle's side to the nearest ground along the arcs that is not known to be drivable.
    """

    at: float
    pose: Pose
    route_clear: float
    route_blocked: bool = False
    arcs: tuple[tuple[float, float], ...] = ()
    clear: float = 0.0
    gap: float = 0.0
