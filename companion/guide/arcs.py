"""Plans two arcs over ground that is known to be drivable, by the mission's way and round what blocks it.

All pairs of arcs from a fixed tree are laid over the local grid at once. Clearance is that of cells' middles
to the nearest middle of a cell that is not free: blocked and unknown ground alike, but for what the vehicle
stands on and the ground straight ahead that is below the picture (`_free`). A point of a way is passable
where the vehicle's width and `MARGIN` m beside it are clear, for the lens and for the vehicle's front.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.grid import CELL, SIDE, LocalGrid
from anytraverse.ground import RELIABLE, GroundCamera
from companion.guide.plan import Outline, Plan, Route
from companion.guide.tree import STEP, TIGHTEST, ArcTree, points_of, tree_of
from companion.guide.way import ahead_of, clear_along, direction

Floats = NDArray[np.float64]
Layer = NDArray[np.float32]
Mask = NDArray[np.bool_]

MARGIN = 0.3
"""m to each side of the vehicle that must be clear, too; cells tell it to half of `CELL`."""
TOUCHING = 0.1
"""m that a vehicle which stands nearer than `MARGIN` to something keeps, on the way out of there."""
_WAY_OUT = 1.0
"""m on which it may."""
_ASTRAY = math.radians(60.0)
"""Against the route: a way that turns farther ends there, so that none leads back."""
_SHORTEST = 0.3
"""m: a shorter way is none."""
_ENDS = 0.25
"""m by which ways may end sooner than the best one."""
_COMFORT = 0.3
"""m of room beside the margin that are better than none."""
_OLD, _FAR = 1.0, 2.0
"""s after which the plan before does not count any more, and m from it after which more are no worse."""
_SHOWN = slice(SIDE // 2 - 70, SIDE // 2 + 70)
"""Rows and columns of the grid over which ways are laid: those of `RELIABLE` m, and some more."""
_NONE: Any = None


class Unsure(NamedTuple):
    """Ground is too uncertain where a tile of it, `tile` m wide, is so by more than `limit` in the mean."""

    limit: float
    tile: float


def plan(
    grid: LocalGrid,
    route: Route,
    outline: Outline,
    far: float,
    at: float,
    *,
    blind: float,
    unsure: Unsure | None = None,
    before: Plan | None = None,
) -> Plan | None:
    """Return the best way over the grid as it is; None where it has no pose, or a value is unusable.

    far: as of `Errand`. at: the frame's capture, monotonic s. blind: see `blind_of`.
    unsure: what is too uncertain to be free, whatever word explains it; None: nothing is. before: the plan of
    the last frame, which is kept to while there is nothing better.
    """
    pose = grid.pose
    if pose is None or not _usable(outline, far, at, route.corridor):
        return None
    course = ahead_of(route.points, pose)
    if course is None:
        return None
    free, half = _free(grid, outline, blind, unsure), outline.width / 2
    route_clear, blocked = clear_along(grid, free, course, pose, half + MARGIN)
    told = Plan(at, pose, float(np.clip(route_clear - outline.front, 0.0, RELIABLE)), blocked)
    tree, room, off = _laid(grid, free, course, outline)
    aim = direction(course, pose)
    astray = np.abs(tree.headings - aim)
    least = half + MARGIN - CELL / 2
    need = np.full(room.shape[1], least, np.float32)
    need[: round(_WAY_OUT / STEP)] = np.clip(room[0, 0], half + TOUCHING, least)
    passable = (room >= need) & (off <= route.corridor) & (astray <= max(_ASTRAY, abs(aim)))
    passable[:, -1] = False
    last = passable.argmin(axis=1) - 1
    progress = tree.points @ (math.cos(aim), math.sin(aim))
    reached = np.where(last > 0, progress[np.arange(len(last)), last], 0.0)
    enough = min(float(reached.max()), far)
    if enough < max(_SHORTEST, blind - half):  # it would end on ground that was never seen
        return told
    ones = np.flatnonzero(reached >= enough - _ENDS)
    ends = np.minimum((progress[ones] >= enough - _ENDS).argmax(axis=1), last[ones])
    until = np.arange(room.shape[1]) <= ends[:, np.newaxis]
    narrowest = np.where(until, room[ones], np.inf).min(axis=1)
    first, second, _ = tree.arcs[ones].T * outline.radius
    costs = (
        np.where(until, off[ones], 0.0).sum(axis=1) / (ends + 1)
        + off[ones, ends]
        + 0.5 * astray[ones, ends]
        + 2.0 * np.maximum(0.0, least + _COMFORT - narrowest)
        + 0.15 * np.abs(first)
        + 0.15 * np.abs(second - first)
        + 0.3 * _apart(grid, before, at, tree.points[ones, ends])
    )
    best = int(ones[costs.argmin()])
    clear = float(last[best] * STEP)
    first, second, switch = map(float, tree.arcs[best])
    arcs = ((first, min(switch, clear)), (second, clear - switch))
    gap = float(room[best, : last[best] + 1].min()) - CELL / 2 - half
    return told._replace(arcs=arcs[: 1 + (clear > switch)], clear=clear, gap=max(0.0, gap))


@lru_cache(8)
def blind_of(camera: GroundCamera, width: float) -> float:
    """Return the m from the lens to the nearest ground in view over this width in m and its margins."""
    return camera.front + camera.nearest(width + 2.0 * MARGIN)


def _usable(outline: Outline, *others: float) -> bool:
    """Return whether these are shapes and amounts that a vehicle may have."""
    sizes = 0.0 < outline.width <= RELIABLE and 0.0 <= outline.front <= RELIABLE
    return sizes and TIGHTEST <= outline.radius < math.inf and all(0.0 <= one < math.inf for one in others)


def _free(grid: LocalGrid, outline: Outline, blind: float, unsure: Unsure | None) -> Mask:
    """Return which cells are free: surely drivable, or unknown and under the vehicle or below the picture.

    Of the latter only straight ahead, as wide as the vehicle and its margins, and not where the picture shows
    a thing that may stand there.
    """
    free, side = grid.drivable & ~_too_uncertain(grid, unsure), outline.width / 2 + MARGIN + CELL
    if blind <= RELIABLE:
        reach = min(SIDE // 2, math.ceil((blind + side) / CELL))
        near = np.arange(SIDE // 2 - reach, SIDE // 2 + reach)
        around = grid.to_vehicle(grid.places(*np.meshgrid(near, near, indexing="ij")))
        below = (np.abs(around[..., 1]) <= side) & (around[..., 0] >= -side) & (around[..., 0] <= blind)
        ahead = np.abs(around[..., 1]) * blind <= around[..., 0] * side
        here = free[near[0] : near[-1] + 1, near[0] : near[-1] + 1]
        here |= below & ~grid.known[near][:, near]
        here &= ~(grid.foot_below[near][:, near] & ahead)
    return free


def _too_uncertain(grid: LocalGrid, unsure: Unsure | None) -> Mask:
    """Return which cells are the middle of a tile of known ground that is too uncertain."""
    if unsure is None:
        return np.zeros((SIDE, SIDE), np.bool_)
    known, size = grid.known.astype(np.float32), max(1, round(unsure.tile / CELL))
    amount, count = (
        cv2.boxFilter(layer, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for layer in (grid.uncertainty * known, known)
    )
    return np.asarray(amount > unsure.limit * count)


def _laid(grid: LocalGrid, free: Mask, course: Floats, outline: Outline) -> tuple[ArcTree, Layer, Layer]:
    """Return the tree, and for each point the m from there to what is not free, and to the mission's way."""
    tree, ahead = tree_of(outline.radius), outline.front - outline.width / 2
    shown = free[_SHOWN, _SHOWN].astype(np.uint8)
    shown[[0, -1]] = shown[:, [0, -1]] = 0
    clearance = cv2.distanceTransform(shown, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    corner = np.array(grid.corner) + _SHOWN.start
    line = np.ones_like(shown)
    cv2.polylines(line, [np.floor(course / CELL - corner).astype(np.int32)], isClosed=False, color=0)
    away = cv2.distanceTransform(line, cv2.DIST_L2, cv2.DIST_MASK_5)
    lens = grid.from_vehicle(np.zeros(2))
    turn = ((grid.from_vehicle(np.eye(2)) - lens) / CELL).astype(np.float32)
    at = tree.points @ turn + (lens / CELL - corner - 0.5).astype(np.float32)
    room, off = _read(clearance, at), _read(away, at)
    if ahead > 0.0:
        room = np.minimum(room, _read(clearance, at + tree.noses @ (turn * np.float32(ahead))))
    return tree, room, off


def _read(layer: Any, at: Layer) -> Layer:
    """Return a layer's distances in m at places in cells; 0 outside of it."""
    return np.asarray(cv2.remap(layer, at, _NONE, cv2.INTER_LINEAR)) * np.float32(CELL)


def _apart(grid: LocalGrid, before: Plan | None, at: float, ends: Floats) -> Floats:
    """Return how many m ends of ways (n, 2) are from the way of the plan before."""
    if before is None or not before.arcs or not 0.0 <= at - before.at <= _OLD:
        return np.zeros(len(ends))
    (first, until), (second, _) = before.arcs[0], before.arcs[-1]
    ways = np.arange(0.0, RELIABLE, 4 * STEP)[:, np.newaxis]
    points = points_of(np.array([[first, second, until]]), ways[:, 0])[0][0]
    turn = math.radians(before.pose.heading)
    c, s = math.cos(turn), math.sin(turn)
    there = grid.to_vehicle(points @ np.array([[c, s], [-s, c]]) + before.pose[:2])
    apart = np.hypot(*(ends[:, np.newaxis] - there).transpose(2, 0, 1)).min(axis=1)
    return np.asarray(np.minimum(apart, _FAR))
