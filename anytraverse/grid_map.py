"""Holds what a local grid knew at one moment, in bytes, and draws it from above. Needs no OpenCV."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image, Pose
from anytraverse.grid import CELL, FREE, SIDE, LocalGrid
from anytraverse.ground import GroundRegion

Bytes = NDArray[np.uint8]
Colour = tuple[int, int, int]

UNKNOWN = 255
"""Of a cell in `GridMap.share` and `GridMap.uncertainty`."""
_HIGHEST = 254
AHEAD, BEHIND, ASIDE = 6.0, 4.0, 4.0
"""m from the lens that a drawing shows."""
_SCALE = 3
"""Pixels a cell."""
_NOT_SEEN: Colour = (222, 226, 230)
_DRIVABLE: Colour = (102, 197, 171)
_BLOCKED: Colour = (213, 94, 0)
_UNEXPLAINED: Colour = (126, 47, 190)
_WAY: Colour = (255, 225, 60)
_STOP: Colour = (200, 30, 30)
_REGION: Colour = (255, 255, 255)
_PLANNED: Colour = (0, 72, 186)
_VEHICLE: Colour = (33, 37, 41)
_METRE: Colour = (160, 166, 172)


@dataclass(frozen=True)
class GridMap:
    """What a `LocalGrid` knew. at: monotonic seconds. corner: as of `LocalGrid`.

    share, uncertainty: SIDE x SIDE bytes, row by row along odometry's y: of each cell the share of frames of
    late that showed it drivable, and its uncertainty, 0 to 254 for 0 to 1; `UNKNOWN` for what is not known.
    """

    at: float
    pose: Pose
    corner: tuple[int, int]
    share: bytes
    uncertainty: bytes

    @classmethod
    def of(cls, grid: LocalGrid, at: float) -> GridMap | None:
        """Copy what a grid knows; None where it does not know where the vehicle is."""
        if grid.pose is None:
            return None
        known = grid.known
        share, uncertainty = (
            np.where(known, np.rint(layer * _HIGHEST), UNKNOWN).astype(np.uint8).tobytes()
            for layer in (grid.share, grid.uncertainty)
        )
        return cls(at, grid.pose, grid.corner, share, uncertainty)

    @property
    def layers(self) -> tuple[Bytes, Bytes]:
        """share and uncertainty as (SIDE, SIDE) arrays."""
        one, other = (
            np.frombuffer(told, np.uint8).reshape(SIDE, SIDE) for told in (self.share, self.uncertainty)
        )
        return one, other


def draw_from_above(
    told: GridMap,
    ground: GroundRegion | None = None,
    stops: float | None = None,
    planned: Sequence[Pose] = (),
) -> Image:
    """Draw what is known around the vehicle, its nose up, with a line each metre ahead of it. RGB uint8.

    ground: the region of interest, which is drawn with the vehicle and its way. stops: m from the vehicle's
    front to where it stands after a hold; a line shows it. planned: poses along the way that is planned round
    something, by odometry, one for each pixel or so.
    """
    share, uncertainty = told.layers
    ahead, left = _middles(AHEAD, BEHIND), _middles(ASIDE, ASIDE)
    turn = math.radians(told.pose.heading)
    x = told.pose.x + ahead[:, np.newaxis] * math.cos(turn) - left * math.sin(turn)
    y = told.pose.y + ahead[:, np.newaxis] * math.sin(turn) + left * math.cos(turn)
    columns, rows = (
        np.floor(places / CELL).astype(np.intp) - first
        for places, first in zip((x, y), told.corner, strict=True)
    )
    inside = (rows >= 0) & (rows < SIDE) & (columns >= 0) & (columns < SIDE)
    cells = np.where(inside, rows * SIDE + columns, 0)
    share = np.where(inside, share.ravel()[cells], UNKNOWN)
    uncertainty = np.where(inside, uncertainty.ravel()[cells], UNKNOWN)
    kinds = (share != UNKNOWN) * (1 + (share < FREE * _HIGHEST) * (1 + (uncertainty > _HIGHEST // 2)))
    colours = np.array([_NOT_SEEN, _DRIVABLE, _BLOCKED, _UNEXPLAINED], np.uint8)
    picture: Image = colours[kinds].repeat(_SCALE, axis=0).repeat(_SCALE, axis=1)
    _draw_vehicle(picture, ground, stops)
    for one in planned:
        _draw_point(picture, one.x - told.pose.x, one.y - told.pose.y, turn)
    return picture


def _middles(first: float, last: float) -> NDArray[np.float64]:
    """Return the middles of cells from `first` m down to `-last` m."""
    return np.asarray(first - (np.arange(round((first + last) / CELL)) + 0.5) * CELL)


def _draw_vehicle(picture: Image, ground: GroundRegion | None, stops: float | None) -> None:
    front = ground.camera.front if ground is not None else 0.0
    for metre in range(1, math.floor(AHEAD - front) + 1):
        _rectangle(picture, (front + metre, ASIDE), (front + metre, -ASIDE), _METRE)
    if ground is None:
        return
    half, wide = ground.vehicle / 2, ground.width / 2
    _rectangle(picture, (front + ground.far, wide), (front + ground.near, -wide), _REGION)
    for side in (half, -half):
        _rectangle(picture, (AHEAD, side), (front, side), _WAY)
    if stops is not None and front + stops <= AHEAD:
        _rectangle(picture, (front + stops, half), (front + stops, -half), _STOP)
    _rectangle(picture, (front, half), (min(0.0, front - 0.3), -half), _VEHICLE)


def _draw_point(picture: Image, x: float, y: float, turn: float) -> None:
    """Mark a place that is x, y m from the vehicle by odometry. turn: of the vehicle, rad."""
    ahead, left = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    row, column = round((AHEAD - ahead) / CELL * _SCALE), round((ASIDE - left) / CELL * _SCALE)
    picture[max(0, row - 1) : max(0, row + 2), max(0, column - 1) : max(0, column + 2)] = _PLANNED


def _rectangle(picture: Image, one: tuple[float, float], other: tuple[float, float], colour: Colour) -> None:
    """Outline a rectangle, or draw a line, between two corners in m ahead and to the left."""
    (top, left), (bottom, right) = (
        (round((AHEAD - ahead) / CELL * _SCALE), round((ASIDE - aside) / CELL * _SCALE))
        for ahead, aside in (one, other)
    )
    height, width = picture.shape[:2]
    top, bottom = max(0, min(top, height - 1)), max(0, min(bottom, height - 1))
    left, right = max(0, min(left, width - 1)), max(0, min(right, width - 1))
    for rows, columns in (
        (slice(top, top + 1), slice(left, right + 1)),
        (slice(bottom, bottom + 1), slice(left, right + 1)),
        (slice(top, bottom + 1), slice(left, left + 1)),
        (slice(top, bottom + 1), slice(right, right + 1)),
    ):
        picture[rows, columns] = colour
