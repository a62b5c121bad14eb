"""Says how the mission leads on from where the vehicle is, and how far ground along that is free."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Pose
from anytraverse.grid import CELL, FARTHEST, LocalGrid
from anytraverse.ground import RELIABLE
from companion.guide.plan import Point, ahead

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

AHEAD = 8.0
"""m of the mission's way that are looked at; where it ends sooner, it is taken to lead straight on."""
CONVERGES = 2.0
"""m in which an autopilot that is beside its way comes back to it."""
_AIM = 5.0
"""m over which the direction of the mission's way is taken."""
_SHORTEST = 0.01
"""m: points of a route that are nearer to each other are one."""
_FOOT = 0.5
"""m: between ground that is drivable and a thing's foot some may be unknown."""
_MOST = 1000
"""Points of a route that are looked at."""


def ahead_of(points: tuple[Point, ...], pose: Pose) -> Floats | None:
    """Return the mission's way from the point nearest to the vehicle on, (n, 2).

    By odometry in m, every `CELL` m. None where these points are none, or lead nowhere.
    """
    told = np.array(points[:_MOST], np.float64).reshape(-1, 2)
    if len(told) < 2 or not (np.abs(told) <= FARTHEST).all():  # False for NaN, too
        return None
    told = told[np.concatenate([[True], np.hypot(*np.diff(told, axis=0).T) >= _SHORTEST])]
    if len(told) < 2:
        return None
    last = told[-1] - told[-2]
    foot, rest = ahead(told.tolist(), pose)
    corners = np.vstack([foot, rest, told[-1] + last * (2.0 * AHEAD / np.hypot(*last))])
    ways = np.concatenate([[0.0], np.hypot(*np.diff(corners, axis=0).T).cumsum()])
    each = np.arange(0.0, AHEAD, CELL)
    return np.column_stack([np.interp(each, ways, corners[:, axis]) for axis in (0, 1)])


def direction(course: Floats, pose: Pose) -> float:
    """Return where a way of `ahead_of` leads over the next metres: rad to the left of the nose."""
    dx, dy = course[round(_AIM / CELL)] - course[0]
    return math.remainder(math.atan2(dy, dx) - math.radians(pose.heading), math.tau)


def clear_along(grid: LocalGrid, free: Mask, course: Floats, pose: Pose, half: float) -> tuple[float, bool]:
    """Return up to how many m from the lens all is free on the way, `half` m to each side of it.

    And whether what ends it, or begins within `_FOOT` m behind that, is known not to be drivable.
    The way is that of an autopilot: it comes back to the mission's within `CONVERGES` m. At most `RELIABLE`.
    """
    part = np.minimum(np.arange(len(course)) * (CELL / CONVERGES), 1.0)[:, np.newaxis]
    way = course + (np.array(pose[:2]) - course[0]) * (1.0 - part * part * (3.0 - 2.0 * part))
    steps = np.diff(way, axis=0)
    lengths = np.maximum(np.hypot(*steps.T), _SHORTEST)
    across = np.column_stack([-steps[:, 1], steps[:, 0]]) / lengths[:, np.newaxis]
    aside = np.linspace(-half, half, math.ceil(4.0 * half / CELL) + 1)
    rows, columns, inside = grid.cells(way[:-1, np.newaxis] + aside[:, np.newaxis] * across[:, np.newaxis])
    going = np.append((free[rows, columns] & inside).all(axis=1), False)
    ends = int(going.argmin())
    blocks = (grid.known[rows, columns] & ~free[rows, columns] & inside)[
        ends : ends + math.ceil(_FOOT / CELL)
    ].any()
    clear = float(lengths[:ends].sum())
    return min(RELIABLE, clear), bool(blocks) and clear < RELIABLE
