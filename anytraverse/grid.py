"""Remembers for some seconds which ground around the vehicle is drivable, in a grid.

Cells are squares of `CELL` m, aligned with the axes of odometry, not with the vehicle: a turn of the vehicle
turns nothing in the grid, and driving on shifts it by whole cells, so that no cell is ever interpolated. The
vehicle is in the middle: what it has passed stays as long as what it comes to, whichever way it turns.

Only ground that a frame shows marks cells: within `RELIABLE` m of the lens, and on each bearing up to the
foot of the first thing. `_BODY` m behind it all becomes unknown, the thing's own ground: from afar it may
have looked drivable. Farther behind, what is drivable stays, and what blocks becomes unknown: a foot that
was seen from afar was seen too far away or too near. Of a thing whose foot is below the picture nobody knows
where it stands: drivable ground before it becomes unknown, and what blocks stays.
What was not seen for `REMEMBERED` s is unknown, and unknown is not free. Odometry that jumps, ends, or is no
number makes everything unknown: so does time that goes back. Odometry is taken for that of the lens. Where it
is that of a point d m behind it, a turn by an angle (rad) moves what is remembered by d times this angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Maps
from anytraverse.frame import Pose
from anytraverse.ground import RELIABLE, STEEPEST, GroundCamera, GroundRegion

Layer = NDArray[np.float32]
Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Cells = NDArray[np.intp]

CELL = 0.1
"""m: the side of a cell."""
SIDE = 200
"""Cells along each side of the grid."""
REMEMBERED = 10.0
"""Seconds after which a cell that was not seen again is unknown."""
FREE = 0.5
"""A known cell is drivable when it has at least this share of frames, of late, that showed it so."""
_NEWEST = 0.4
"""The weight of a new frame in a cell that is known already."""
_SHALLOWEST, _DEEPEST = 0.15, 0.3
"""m from the last ground before a thing, between which its foot's mark ends: more than a cell."""
_FASTEST, _STEP = 5.0, 0.2
"""m/s and m: odometry that goes farther between two frames has jumped."""
_QUICKEST, _TURN = 120.0, 5.0
"""degrees/s and degrees: the same of its heading."""
FARTHEST = 1e6
"""m from its start within which odometry is believed."""
_BODY = 1.0
"""m behind the last ground before a thing that are the thing's own, or hidden: nothing is known there."""
_FINEST = 96
"""Pixels a side of the maps that are used; the built-in's have 64."""
_BINS_A_PIXEL = 2
"""Bins of bearings, for each of the picture's columns in its middle."""
_MIDDLE = SIDE // 2
_REACH = math.ceil(RELIABLE / CELL)


@dataclass(frozen=True, eq=False)
class GroundPatch:
    """What is known of a rectangle before the vehicle; rows from far to near, columns from left to right.

    They are as large as cells. drivable, known: (rows, columns). uncertainty: the same, 1 where unknown.
    """

    drivable: Mask
    known: Mask
    uncertainty: Layer


class LocalGrid:
    """Layers of (SIDE, SIDE) cells: the row counts along odometry's y, the column along its x.

    corner: the number of the first cell's column and row, counted from odometry's start. age: seconds since a
    cell was seen, infinite for never. foot_below: below the picture of the newest frame, where
    in that direction a thing stands of which no frame has shown the foot.
    """

    def __init__(self) -> None:
        self.corner = (0, 0)
        self.pose: Pose | None = None
        self.share: Layer = np.zeros((SIDE, SIDE), np.float32)
        self.uncertainty: Layer = np.ones((SIDE, SIDE), np.float32)
        self.age: Layer = np.full((SIDE, SIDE), np.inf, np.float32)
        self.foot_below: Mask = np.zeros((SIDE, SIDE), np.bool_)
        self._at = -math.inf

    @property
    def known(self) -> Mask:
        """Cells that were seen within `REMEMBERED` s."""
        return np.asarray(self.age <= REMEMBERED)

    @property
    def drivable(self) -> Mask:
        """Known cells that are drivable."""
        return np.asarray(self.known & (self.share >= FREE))

    @property
    def blocked(self) -> Mask:
        """Known cells that are not."""
        return np.asarray(self.known & (self.share < FREE))

    def forget(self) -> None:
        """Make every cell unknown, and the vehicle's place with them."""
        self.age.fill(np.inf)
        self.foot_below[:] = False
        self.pose, self._at = None, -math.inf

    def update(self, maps: Maps, camera: GroundCamera, pose: Pose | None, now: float) -> None:
        """Take in a frame. camera: leaning as it did at `now`, the frame's capture in monotonic seconds.

        Maps of more than `_FINEST` pixels a side are made coarser, so that the work is bounded.
        """
        self.move(pose, now)
        if self.pose is not None and max(abs(camera.pitch), abs(camera.bank)) <= STEEPEST:
            drivable, uncertainty = maps.drivable, maps.uncertainty
            for axis in (0, 1):
                if (size := drivable.shape[axis]) > _FINEST:
                    starts = np.arange(_FINEST) * size // _FINEST
                    drivable = np.logical_and.reduceat(drivable, starts, axis=axis)
                    uncertainty = np.maximum.reduceat(uncertainty, starts, axis=axis)
            self._see(drivable, uncertainty, camera, self.pose)

    def move(self, pose: Pose | None, now: float) -> None:
        """Let time pass and the vehicle drive, without a frame."""
        if pose is None or not _believable(pose, now):
            self.forget()
            return
        passed = now - self._at
        if self.pose is not None and not (passed >= 0.0 and _drives(self.pose, pose, passed)):
            self.forget()
        elif self.pose is not None:
            self.age += np.float32(passed)
        self._shift((math.floor(pose.x / CELL) - _MIDDLE, math.floor(pose.y / CELL) - _MIDDLE))
        self.pose, self._at = pose, now

    def cells(self, places: Floats) -> tuple[Cells, Cells, Mask]:
        """Return rows and columns of the cells at places (..., 2) of odometry in m, and which of them exist.

        Where none does they are those of the middle.
        """
        found = np.floor(places / CELL) - self.corner
        inside: Mask = np.asarray(((found >= 0) & (found < SIDE)).all(axis=-1))
        whole = np.where(inside[..., np.newaxis], found, _MIDDLE).astype(np.intp)
        return whole[..., 1], whole[..., 0], inside

    def places(self, rows: Cells, columns: Cells) -> Floats:
        """Return where the middles of cells are by odometry, (..., 2) in m."""
        return np.stack([columns + 0.5 + self.corner[0], rows + 0.5 + self.corner[1]], axis=-1) * CELL

    def from_vehicle(self, ground: Floats) -> Floats:
        """Return where places (..., 2) in m ahead of the lens and to its left are by odometry.

        Raises ValueError where the vehicle's place is not known.
        """
        pose, turn = self._placed()
        return np.asarray(ground @ turn.T + (pose.x, pose.y))

    def to_vehicle(self, places: Floats) -> Floats:
        """Do the opposite of `from_vehicle`."""
        pose, turn = self._placed()
        return np.asarray((places - (pose.x, pose.y)) @ turn)

    def patch(self, ground: GroundRegion, near: float = 0.0) -> GroundPatch:
        """Return what is known of a region's ground, from `near` m before the vehicle's front on.

        By default that is from the front itself, which the picture does not show; below 0 it is under the
        vehicle. Without a place of the vehicle all of it is unknown.
        """
        rows = max(1, round((ground.far - near) / CELL))
        columns = max(1, round(ground.width / CELL))
        if self.pose is None:
            none = np.zeros((rows, columns), np.bool_)
            return GroundPatch(none, none, np.ones((rows, columns), np.float32))
        ahead = ground.camera.front + ground.far - (np.arange(rows) + 0.5) * CELL
        left = ground.width / 2 - (np.arange(columns) + 0.5) * CELL
        places = self.from_vehicle(np.stack(np.meshgrid(ahead, left, indexing="ij"), axis=-1))
        row, column, inside = self.cells(places)
        known = inside & (self.age[row, column] <= REMEMBERED)
        uncertainty = np.where(known, self.uncertainty[row, column], np.float32(1.0))
        return GroundPatch(known & (self.share[row, column] >= FREE), known, uncertainty)

    def _placed(self) -> tuple[Pose, Floats]:
        if self.pose is None:
            raise ValueError("the vehicle's place is not known")
        c, s = math.cos(math.radians(self.pose.heading)), math.sin(math.radians(self.pose.heading))
        return self.pose, np.array([[c, -s], [s, c]])

    def _shift(self, corner: tuple[int, int]) -> None:
        """Move the grid's first cell there, without a change of what is known where."""
        by = corner[0] - self.corner[0], corner[1] - self.corner[1]
        self.corner = corner
        if by == (0, 0):
            return
        (to_columns, columns), (to_rows, rows) = (_overlap(one) for one in by)
        for layer, empty in (
            (self.share, 0.0),
            (self.uncertainty, 1.0),
            (self.age, np.inf),
            (self.foot_below, False),
        ):
            kept = layer[rows, columns].copy()
            layer.fill(empty)
            layer[to_rows, to_columns] = kept

    def _see(self, drivable: Mask, uncertainty: Layer, camera: GroundCamera, pose: Pose) -> None:
        """Mark the cells that the frame shows."""
        height, width = drivable.shape
        begin = _MIDDLE - _REACH
        numbers = np.arange(begin, _MIDDLE + _REACH + 1) + 0.5
        x, y = ((numbers + self.corner[axis]) * CELL - pose[axis] for axis in (0, 1))
        y = y[:, np.newaxis]
        view = np.diag((width, height, 1.0)) @ camera.homography
        view[:, :2] = view[:, :2] @ self._placed()[1].T
        across, down, depth = (line[0] * x + (line[1] * y + line[2]) for line in view)
        away = x * x + y * y
        shown = (depth > 0.0) & (across >= 0.0) & (down >= 0.0) & (away <= RELIABLE * RELIABLE)
        rows, columns = np.nonzero(shown & (across < width * depth) & (down < height * depth))
        feet = _Feet(~drivable, camera)
        bins = feet.bins(np.arctan2(y[rows, 0], x[columns]) - math.radians(pose.heading))
        ways = np.sqrt(away[rows, columns])
        seen = ways <= feet.far[bins]
        hidden = ~seen & (feet.far[bins] > 0.0)
        self._forget(rows[hidden] + begin, columns[hidden] + begin, drivable=False)
        behind = hidden & (ways <= feet.near[bins] + _BODY)
        self._forget(rows[behind] + begin, columns[behind] + begin, drivable=True)
        rows, columns, ground = rows[seen], columns[seen], (ways <= feet.near[bins])[seen]
        pixels = tuple(
            (line[rows, columns] / depth[rows, columns]).astype(np.intp) for line in (down, across)
        )
        cells = rows + begin, columns + begin
        weight = np.where(self.age[cells] <= REMEMBERED, np.float32(_NEWEST), np.float32(1.0))
        self.share[cells] += weight * ((drivable[pixels] & ground) - self.share[cells])
        self.uncertainty[cells] += weight * (uncertainty[pixels] - self.uncertainty[cells])
        self.age[cells] = 0.0
        self.foot_below[:] = False
        if feet.below > 0.0:
            rows, columns = np.nonzero(away <= (feet.below + _DEEPEST) ** 2)
            bearings = np.arctan2(y[rows, 0], x[columns]) - math.radians(pose.heading)
            bins, ways = feet.bins(bearings), np.sqrt(away[rows, columns])
            rows, columns = rows + begin, columns + begin
            stands = self.blocked[rows, columns]
            where = (feet.far[bins] == 0.0) & (ways <= feet.below)
            self._forget(rows[where], columns[where], drivable=True)
            where &= ~feet.near_to(bearings[stands], ways[stands])[bins]
            self.foot_below[rows[where], columns[where]] = True

    def _forget(self, rows: Cells, columns: Cells, *, drivable: bool) -> None:
        """Make those of the cells unknown that are drivable, or those that are not."""
        ones = (self.share[rows, columns] >= FREE) == drivable
        self.age[rows[ones], columns[ones]] = np.inf


class _Feet:
    """On which way from the lens, on each bearing, a picture shows the foot of the first thing; m, by bin.

    A pixel is a thing's from half of it on, so that its foot is between the middles of the last pixel of
    ground and the first of the thing. near: the first of them, up to which ground is seen. far: the other,
    but at most `_DEEPEST` behind `near`. Both are infinite where no thing is, and 0 where its foot is below
    the picture. below: m from the lens to the ground below the picture, at most, where any foot is; else 0.
    """

    def __init__(self, thing: Mask, camera: GroundCamera) -> None:
        height, width = thing.shape
        middles = (np.arange(height + 1) + 0.5) / height
        edges = np.stack(np.meshgrid(np.arange(width + 1) / width, middles), axis=-1)
        ground = camera.to_ground(edges.reshape(-1, 2)).reshape(height + 1, width + 1, 2)
        ways = np.hypot(ground[..., 0], ground[..., 1])
        self._heading = math.radians(camera.heading)
        self._count = math.ceil(math.tau * camera.lens.focal_x * width * _BINS_A_PIXEL)
        near = np.minimum(ways[1:, :-1], ways[1:, 1:])
        rows, columns = np.nonzero(thing & (near <= RELIABLE))
        near, far = near[rows, columns], np.fmax(ways[rows, columns], ways[rows, columns + 1])
        far = np.fmax(np.minimum(far, near + _DEEPEST), near + _SHALLOWEST)
        last_row = rows == height - 1
        self.below = float(near[last_row].max(initial=0.0))
        near[last_row] = far[last_row] = 0.0
        bins = self.bins(np.arctan2(ground[1:, :, 1], ground[1:, :, 0]))
        first, last = bins[rows, columns + 1], bins[rows, columns]
        order = np.argsort(-near)  # of those in one bin the last assigned stays: the nearest
        counts = np.maximum(last - first, 0)[order] + 1
        ends = counts.cumsum()
        at = np.repeat(first[order] + counts - ends, counts) + np.arange(ends[-1] if ends.size else 0)
        self.near, self.far = np.full((2, self._count), np.inf)
        self.near[at], self.far[at] = np.repeat(near[order], counts), np.repeat(far[order], counts)

    def near_to(self, bearings: Floats, ways: Floats) -> Mask:
        """Return which bins cells cover that lie so many rad to the left of the nose, and so many m away."""
        half = np.arctan2(CELL, ways)
        first, last = self.bins(bearings - half), self.bins(bearings + half)
        found: Mask = np.zeros(self._count, np.bool_)
        for one, other in set(zip(first.tolist(), last.tolist(), strict=True)):
            if one <= other:
                found[one : other + 1] = True
            else:
                found[one:] = found[: other + 1] = True
        return found

    def bins(self, bearings: Floats) -> Cells:
        """Return the bin of each bearing, in rad to the left of the vehicle's nose."""
        turned = np.mod(bearings + self._heading + math.pi, math.tau) * (self._count / math.tau)
        return np.asarray(np.minimum(np.nan_to_num(turned).astype(np.intp), self._count - 1))


def _overlap(by: int) -> tuple[slice, slice]:
    """Return where cells of an axis go, and which of them are kept, when the grid moves on by so many."""
    kept = max(0, SIDE - abs(by))
    return (slice(0, kept), slice(by, by + kept)) if by > 0 else (slice(SIDE - kept, SIDE), slice(0, kept))


def _believable(pose: Pose, now: float) -> bool:
    return all(map(math.isfinite, (*pose, now))) and max(abs(pose.x), abs(pose.y)) <= FARTHEST


def _drives(one: Pose, other: Pose, passed: float) -> bool:
    """Return whether a vehicle may have driven from one pose to the other in so many seconds."""
    turned = abs(math.remainder(other.heading - one.heading, 360.0))
    way = math.hypot(other.x - one.x, other.y - one.y)
    return way <= _FASTEST * passed + _STEP and turned <= _QUICKEST * passed + _TURN
