"""A vehicle that follows its plans on a trail along odometry's x, in virtual time, with true maps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from anytraverse.assessment import Maps
from anytraverse.frame import Pose
from anytraverse.grid import LocalGrid
from anytraverse.ground import GroundCamera
from companion.guide.arcs import blind_of, plan
from companion.guide.plan import Outline, Plan, Route
from companion.guide.rules import Guide
from companion.guide.tree import points_of

CAMERA = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3, front=0.3)
OUTLINE = Outline(0.6, 0.3, 1.5)
BLIND = blind_of(CAMERA, OUTLINE.width)
REAR = 0.7
"""m from the lens back to the vehicle's end."""
ROUTE = Route(((-5.0, 0.0), (60.0, 0.0)), 3.0)
ROWS, COLUMNS = 48, 64
_MIDDLES = np.meshgrid((np.arange(COLUMNS) + 0.5) / COLUMNS, (np.arange(ROWS) + 0.5) / ROWS)
_SEEN = CAMERA.to_ground(np.stack(_MIDDLES, axis=-1).reshape(-1, 2)).reshape(ROWS, COLUMNS, 2)
_STEP = 0.05
_LATE, _LAG, _LOOKS = 0.15, 0.2, 0.8
"""s from a frame until its plan is followed, s by which the turn lags, m by which the vehicle looks ahead."""


@dataclass(frozen=True)
class Trail:
    """half: m to each side of its middle. drums: x, y and radius, each 0.88 m high. wall: x of one across."""

    half: float
    drums: tuple[tuple[float, float, float], ...] = ()
    wall: float = math.inf

    def maps(self, pose: Pose) -> Maps:
        """What is in the picture."""
        turn = math.radians(pose.heading)
        c, s = math.cos(turn), math.sin(turn)
        ground = _SEEN @ np.array([[c, s], [-s, c]]) + pose[:2]
        thing = ~(np.abs(ground[..., 1]) <= self.half) | (ground[..., 0] > self.wall)
        rays = ground - pose[:2]
        for x, y, radius in self.drums:
            to = np.array([x, y]) - pose[:2]
            square, along = (rays * rays).sum(axis=-1), rays @ to
            with np.errstate(invalid="ignore"):
                half = np.sqrt(along * along - square * (to @ to - radius * radius))
                enters, leaves = (along - half) / square, (along + half) / square
                thing |= (enters > 0.0) & (enters < 1.0) & (1.0 - np.minimum(leaves, 1.0) <= 0.88)
        uncertainty = np.where(thing, 0.9, 0.05).astype(np.float32)
        signed, known = 1.0 - uncertainty, np.ones_like(thing)
        return Maps(signed[np.newaxis], signed, uncertainty, uncertainty, ~thing, np.zeros(1, bool), known)

    def room(self, pose: Pose) -> tuple[float, float]:
        """m from the vehicle's body to the nearest drum, and to the trail's edge or the wall."""
        turn, half = math.radians(pose.heading), OUTLINE.width / 2
        c, s = math.cos(turn), math.sin(turn)
        nearest = math.inf
        for x, y, radius in self.drums:
            ahead, left = c * (x - pose.x) + s * (y - pose.y), c * (y - pose.y) - s * (x - pose.x)
            out = max(-REAR - ahead, ahead - OUTLINE.front, 0.0), max(abs(left) - half, 0.0)
            nearest = min(nearest, math.hypot(*out) - radius)
        corners = [(a, b) for a in (OUTLINE.front, -REAR) for b in (half, -half)]
        edge = min(self.half - abs(pose.y + s * a + c * b) for a, b in corners)
        return nearest, min(edge, self.wall - max(pose.x + c * a - s * b for a, b in corners))


@dataclass
class Ridden:
    """What came of a ride. drum, edge: the nearest that the body came, in m."""

    pose: Pose
    drum: float = math.inf
    edge: float = math.inf
    plans: list[Plan] = field(default_factory=list)


def ride(trail: Trail, hertz: float, seconds: float, speed: float = 1.5, start: Pose | None = None) -> Ridden:
    """Drive for so long; without arcs, or at their end, the vehicle stands."""
    grid, ridden, rate = LocalGrid(), Ridden(start or Pose(0.0, 0.0, 0.0)), 0.0
    waiting: list[Plan] = []
    now: Plan | None = None
    taken = -math.inf
    for number in range(round(seconds / _STEP)):
        at, pose = number * _STEP, ridden.pose
        if at >= taken + 1.0 / hertz - 1e-6:
            taken = at
            grid.update(trail.maps(pose), CAMERA, pose, at)
            before = ridden.plans[-1] if ridden.plans else None
            made = plan(
                grid, ROUTE, OUTLINE, Guide(OUTLINE.radius, 1.0).far(speed), at, blind=BLIND, before=before
            )
            assert made is not None
            ridden.plans.append(made)
            waiting.append(made)
        if waiting and at >= waiting[0].at + _LATE:
            now = waiting.pop(0)
        curvature = None if now is None else follow(now, pose)
        going = 0.0 if curvature is None else speed
        rate += (going * (curvature or 0.0) - rate) * _STEP / _LAG
        turn = math.radians(pose.heading) + rate * _STEP / 2
        ridden.pose = Pose(
            pose.x + going * _STEP * math.cos(turn),
            pose.y + going * _STEP * math.sin(turn),
            pose.heading + math.degrees(rate * _STEP),
        )
        drum, edge = trail.room(ridden.pose)
        ridden.drum, ridden.edge = min(ridden.drum, drum), min(ridden.edge, edge)
    return ridden


def way(made: Plan, step: float = 0.05) -> np.ndarray:
    """Points of a plan's arcs by odometry, (n, 2) in m."""
    (first, until), (second, _) = made.arcs[0], made.arcs[-1]
    each = np.append(np.arange(0.0, made.clear, step), made.clear)
    points = points_of(np.array([[first, second, until]]), each)[0][0]
    turn = math.radians(made.pose.heading)
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + made.pose[:2])


def follow(made: Plan, pose: Pose) -> float | None:
    """The curvature to the point of the arcs that is some way ahead; None: stand."""
    if not made.arcs:
        return None
    points = way(made) - pose[:2]
    nearest = int(np.hypot(*points.T).argmin())
    if nearest >= len(points) - 3:
        return None
    x, y = points[min(len(points) - 1, nearest + round(_LOOKS / 0.05))]
    turn = math.radians(pose.heading)
    left = math.cos(turn) * y - math.sin(turn) * x
    return float(np.clip(2.0 * left / (x * x + y * y), -1.0 / OUTLINE.radius, 1.0 / OUTLINE.radius))
