"""Defines what a plan is: two arcs over ground that is known to be drivable. In m, and angles in degrees."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from anytraverse.frame import Pose


class Route(NamedTuple):
    """The way that the mission drives, as a polyline by odometry.

    points: (x, y) in m, from a point behind the vehicle or beside it onwards; at least two. corridor: m to
    each side of it that the vehicle may leave it by.
    """

    points: tuple[tuple[float, float], ...]
    corridor: float

    def at(self, pose: Pose) -> tuple[float, float]:
        """Return where it leads beside a pose, in degrees counter-clockwise, and how much is left of it."""
        nearest, heading, left = math.inf, 0.0, 0.0
        for start, end in pairwise(self.points):
            leg = end[0] - start[0], end[1] - start[1]
            length = math.hypot(*leg) or 1e-9
            along = ((pose.x - start[0]) * leg[0] + (pose.y - start[1]) * leg[1]) / length
            driven = max(0.0, min(length, along))
            foot = start[0] + leg[0] * driven / length, start[1] + leg[1] * driven / length
            away = math.hypot(pose.x - foot[0], pose.y - foot[1])
            if away < nearest:
                nearest, heading, left = away, math.degrees(math.atan2(leg[1], leg[0])), 0.0
                length -= driven
            left += length
        return heading, left


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
