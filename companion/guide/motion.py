"""Calculates how fast to drive along a plan's arcs, and how fast to turn. Pure.

It steers by pure pursuit (Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
CMU-RI-TR-92-01, 1992). Lengths in m, angles in degrees counter-clockwise, speeds in m/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from anytraverse.frame import Pose
from companion.guide.plan import Plan
from companion.vehicle import motion

SPARE = 0.5
"""m of the clear way that are never counted on."""
STOPS_IN = 2.26
"""s: the way to a standstill by the speed, at least. Measured with ArduPilot Rover's brake at 1.5 m/s."""
NARROW = 0.6
"""m from the vehicle's side within which something counts as passed: slowly."""
ASIDE = 1.0
"""m/s2 to the side in a turn, at most."""
_SLOWEST = 0.15
"""m/s below which it stands instead."""
_AHEAD, _AHEAD_FOR = 0.6, 0.6
"""Pursued is the point so many m ahead, or as far as it drives in so many s."""
_ASTRAY = 1.0
"""m from the arcs beyond which they say nothing any more, as where the odometry began anew."""
_STEP = 0.05


class Target(NamedTuple):
    """What GUIDED is asked for. speed: m/s. yaw_rate: degrees/s, counter-clockwise."""

    speed: float
    yaw_rate: float


STAND = Target(0.0, 0.0)


def passing_speed(speed: float) -> float:
    """Return how fast something is passed by a vehicle that drives `speed` m/s otherwise."""
    return max(0.5, 0.6 * speed) if speed > 0.5 else speed


def follow(plan: Plan, pose: Pose, speed: float, stops_in: float, radius: float) -> Target:
    """Return the target that follows the arcs from where the vehicle is now.

    speed: the fastest that is wanted. stops_in: s, see `STOPS_IN`. radius: of the tightest turn.
    """
    points = poses_along(plan)
    driven = min(range(len(points)), key=lambda n: math.hypot(points[n].x - pose.x, points[n].y - pose.y))
    if math.hypot(points[driven].x - pose.x, points[driven].y - pose.y) > _ASTRAY:
        return STAND
    left = plan.clear - driven * _STEP
    wanted = passing_speed(speed) if plan.gap < NARROW else speed
    wanted = min(wanted, (left - SPARE) / stops_in)
    if not plan.arcs or wanted < _SLOWEST:
        return STAND
    ahead = points[min(len(points) - 1, driven + round(max(_AHEAD, _AHEAD_FOR * wanted) / _STEP))]
    curvature = _curvature(pose, ahead)
    curvature = max(-1.0 / radius, min(1.0 / radius, curvature))
    if curvature:
        wanted = min(wanted, math.sqrt(ASIDE / abs(curvature)))
    return Target(wanted, math.degrees(wanted * curvature))


def _curvature(pose: Pose, goal: Pose) -> float:
    """Return the curvature of the arc from a pose to a point, along the nose at its beginning."""
    heading, x, y = math.radians(pose.heading), goal.x - pose.x, goal.y - pose.y
    away = math.hypot(x, y)
    if away < _STEP:
        return 0.0
    return 2.0 * (y * math.cos(heading) - x * math.sin(heading)) / away**2


def poses_along(plan: Plan) -> list[Pose]:
    """Return poses along a plan's arcs, 0.05 m apart, from the one where it was made."""
    poses = [plan.pose]
    for curvature, length in plan.arcs:
        begin = poses[-1]
        poses += [moved(begin, _STEP * (n + 1), curvature) for n in range(round(length / _STEP))]
    return poses


def moved(pose: Pose, way: float, curvature: float) -> Pose:
    """Return the pose after `way` m on an arc."""
    turned = way * curvature
    chord = way if abs(turned) < 1e-6 else 2.0 * math.sin(turned / 2.0) / curvature
    return motion.moved(pose, chord, math.degrees(turned))
