"""Measures whether the grid that remembers for seconds knows the ground better than a frame alone does.

A frame alone is a grid that has forgotten all before it. Both are judged in each frame, in cells of 0.1 m
from 2 m ahead of the lens to 6 m from it and up to 2 m to its sides, where odometry puts them:

- A free cell is farther than a cell from everything that stands or lies there: borders do not count.
- An obstacle's cell lies in a drum, rock or log that was put on the trail, and no nearer than its middle: the
  simulation draws a thing as a flat picture that stands there, and ground before it.
- false_blocks: the share of the free cells that are known, and not drivable. unknown: that are not known.
- obstacle_recall: the share of the obstacles' cells that are not drivable: unknown is not free.
  marked: the same of those cells that are known.

A thing is hidden when its middle is below the picture and not yet under the lens. It is held when a cell at
most 0.2 m from it is known, and not drivable. A frame alone holds none. The way is that of a vehicle 0.6 m
wide through a region 1.2 m wide and up to 4 m before its front: closed frames are those in which none leads
through, though nothing stands there (false), and the first before a drum in the middle of the trail.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Maps
from anytraverse.findings import is_open
from anytraverse.frame import Pose
from anytraverse.grid import CELL, SIDE, GroundPatch, LocalGrid
from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.judging import Settings
from anytraverse.regions import Box
from anytraverse.roi import corridor_open
from bench.ground.drives import FieldDrive, Odometry, Placed, SeenFrame, drive, gaps
from companion.sim.field.lens import FIELD_OF_VIEW, HEIGHT, PITCH, relative

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEAR, FAR, ASIDE = 2.0, 6.0, 2.0
"""m in which cells are judged."""
SETTLED = 20
"""Frames at the beginning that do not count: the ground under the rover was never in a picture."""
HELD = 0.2
GOALS = {"obstacle_recall": (0.98, 1.0), "false_blocks": (0.0, 0.003)}
CAMERA = GroundCamera.pinhole(HEIGHT, math.degrees(PITCH), math.degrees(FIELD_OF_VIEW), 4 / 3, 0.3)
REGION = GroundRegion.in_view(CAMERA, 0.0, 4.0, 1.2, 0.6)
SETTINGS = Settings(ground=REGION, region=REGION.in_picture(None).region.bounds)
ODOMETRIES = {"": (0.0, 0.0), ", odometry errs": (0.02, 0.2)}
"""Share of the speed and degrees/s by which odometry is wrong."""
WAYS = ("single", "cells", "grid", "front")
"""Of a frame alone in the picture and in cells, of the grid, and of the grid from the vehicle's front on."""
HEADLINE = "truth, swing 2, odometry errs"


@dataclass
class Cells:
    """Counts cells, see above."""

    free: int = 0
    false: int = 0
    unknown: int = 0
    obstacle: int = 0
    missed: int = 0
    marked: int = 0

    def add(self, free: Mask, obstacle: Mask, drivable: Mask, known: Mask) -> None:
        """Count a frame's cells."""
        self.free += int(free.sum())
        self.false += int((free & known & ~drivable).sum())
        self.unknown += int((free & ~known).sum())
        self.obstacle += int(obstacle.sum())
        self.missed += int((obstacle & drivable).sum())
        self.marked += int((obstacle & known & ~drivable).sum())

    def told(self) -> dict[str, float]:
        """Return the figures."""
        shares = {
            "false_blocks": self.false / max(1, self.free),
            "unknown": self.unknown / max(1, self.free),
            "obstacle_recall": 1.0 - self.missed / max(1, self.obstacle),
            "marked": self.marked / max(1, self.marked + self.missed),
        }
        return {name: round(share, 4) for name, share in shares.items()}


@dataclass
class Way:
    """Counts closed frames. first: the number of the first frame before a drum, by its id."""

    free: int = 0
    false: int = 0
    first: dict[str, int] = field(default_factory=dict)


@dataclass
class Figures:
    """What came of drives. hidden, held: frames of things, by their id. eligible: a drum's first frame.

    ways: by name, see `WAYS`.
    """

    cells: dict[str, Cells] = field(default_factory=lambda: {name: Cells() for name in ("single", "grid")})
    ways: dict[str, Way] = field(default_factory=lambda: {name: Way() for name in WAYS})
    hidden: dict[str, int] = field(default_factory=dict)
    held: dict[str, int] = field(default_factory=dict)
    eligible: dict[str, int] = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """Return all figures. frames_later: mean, least and most by which the grid closes the way later."""
        late = {
            name: [
                way.first[drum] - self.ways["single"].first[drum]
                for drum in self.eligible
                if drum in way.first and drum in self.ways["single"].first
            ]
            for name, way in self.ways.items()
        }
        return {
            **{name: one.told() for name, one in self.cells.items()},
            "obstacle_cells": self.cells["grid"].obstacle,
            "hidden_things": len(self.hidden),
            "held_to_the_end": sum(self.held.get(name) == count for name, count in self.hidden.items()),
            "hidden_frames": sum(self.hidden.values()),
            "held_frames": sum(self.held.values()),
            "free_frames": self.ways["single"].free,
            "false_closed": {name: way.false for name, way in self.ways.items()},
            "drums": len(self.eligible),
            "drums_found": {name: len(way.first) for name, way in self.ways.items()},
            "frames_later": {
                name: [round(float(np.mean(found)), 2), min(found), max(found)]
                for name, found in late.items()
                if found and name != "single"
            },
        }


class Watch:
    """Follows a drive with a grid of one perceiver's maps and one odometry."""

    def __init__(self, drive: FieldDrive, perceiver: str, odometry: Odometry, figures: Figures) -> None:
        self._drive, self._perceiver, self._odometry, self._figures = drive, perceiver, odometry, figures
        self._grid = LocalGrid()

    def take(self, number: int, frame: SeenFrame) -> None:
        """Take in a frame."""
        pose, camera = self._odometry.at(frame), CAMERA.leaning(*(frame.lean or (0.0, 0.0)))
        maps, single = frame.maps[self._perceiver], LocalGrid()
        for grid in (single, self._grid):
            grid.update(maps, camera, pose, frame.at)
        if number < SETTLED:
            return
        rows, columns, ground = _judged(single)
        free, obstacle = truth(self._drive, frame, ground)
        for name, grid in (("single", single), ("grid", self._grid)):
            drivable, known = grid.drivable[rows, columns], grid.known[rows, columns]
            self._figures.cells[name].add(free, obstacle, drivable, known)
        self._count_held(frame, camera)
        self._count_ways(number, frame, maps, single)

    def _count_held(self, frame: SeenFrame, camera: GroundCamera) -> None:
        blocked = self._grid.to_vehicle(self._grid.places(*np.nonzero(self._grid.blocked)))
        for one in self._drive.placed:
            ahead, left = relative(frame.pose, one.thing.x, one.thing.y)
            if not (0.0 < ahead < NEAR and abs(left) < ASIDE and one.in_the_way(REGION.vehicle / 2)):
                continue
            if camera.to_picture(np.array([[ahead, left]]))[0, 1] > 1.0:
                held = bool((gaps(one.thing, frame.pose, blocked) <= HELD).any())
                name = f"{self._drive.world.seed} {one.thing.id}"
                self._figures.hidden[name] = self._figures.hidden.get(name, 0) + 1
                self._figures.held[name] = self._figures.held.get(name, 0) + held

    def _count_ways(self, number: int, frame: SeenFrame, maps: Maps, single: LocalGrid) -> None:
        ways = {
            "single": is_open(maps.drivable, CAMERA.lens.aspect, SETTINGS.at(frame.lean)),
            "cells": leads_through(single.patch(REGION, REGION.near)),
            "grid": leads_through(self._grid.patch(REGION, REGION.near)),
            "front": leads_through(self._grid.patch(REGION)),
        }
        nearest, free = _first_in_region(self._drive, frame)
        drum = nearest is not None and nearest.middle and f"{self._drive.world.seed} {nearest.thing.id}"
        if drum:
            self._figures.eligible.setdefault(drum, number)
        for name, opened in ways.items():
            way = self._figures.ways[name]
            way.free += free
            way.false += free and not opened
            if drum and not opened:
                way.first.setdefault(drum, number)


def leads_through(patch: GroundPatch) -> bool:
    """Return whether the vehicle fits through a patch of `REGION`, as `is_open` says it of a picture."""
    share = REGION.vehicle / REGION.width
    corridor = SETTINGS.corridor.__class__(share, share)
    gap = max(1, round(corridor.gap * patch.drivable.shape[1]))
    return corridor_open(patch.drivable, Box(0.0, 0.0, 1.0, 1.0), corridor, (gap, gap))


def truth(drive: FieldDrive, frame: SeenFrame, ground: Floats) -> tuple[Mask, Mask]:
    """Return which places (n, 2), m ahead of the lens and to its left, are free, and which an obstacle's."""
    least, obstacle = np.full(len(ground), np.inf), np.zeros(len(ground), np.bool_)
    for thing in drive.world.things.values():
        ahead, left = relative(frame.pose, thing.x, thing.y)
        if math.hypot(ahead, left) > FAR + 3.0:
            continue
        away = gaps(thing, frame.pose, ground)
        least = np.minimum(least, away)
        if thing.surprise:
            obstacle |= (away <= 0.0) & (ground[:, 0] >= ahead - CELL / 2)
    return least > CELL, obstacle


def _judged(grid: LocalGrid) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return rows and columns of the cells that are judged, and their places ahead of the lens."""
    rows, columns = (one.ravel() for one in np.indices((SIDE, SIDE)))
    ground = grid.to_vehicle(grid.places(rows, columns))
    inside = (ground[:, 0] >= NEAR) & (np.hypot(*ground.T) <= FAR) & (np.abs(ground[:, 1]) <= ASIDE)
    return rows[inside], columns[inside], ground[inside]


def _first_in_region(drive: FieldDrive, frame: SeenFrame) -> tuple[Placed | None, bool]:
    """Return what was put down and is first in the region's way, and whether nothing is in or near it."""
    end, free = REGION.camera.front + REGION.far, True
    nearest, first = math.inf, None
    for one in drive.placed:
        ahead, left = relative(frame.pose, one.thing.x, one.thing.y)
        reach = max(one.thing.radius, one.thing.length / 2)
        if abs(left) - reach < REGION.width / 2:
            free &= not -1.0 < ahead < end + 1.0
            if REGION.camera.front < ahead < end and ahead < nearest:
                nearest, first = ahead, one
    return first, free


def compare(
    seeds: Sequence[int], metres: float, swings: Sequence[float], perceivers: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Drive all seeds; return the figures by perceiver, swing and odometry, and print them."""
    told: dict[str, dict[str, Any]] = {}
    for swing in swings:
        found: dict[str, Figures] = {}
        for seed in seeds:
            follow(drive(seed, swing, metres, perceivers), swing, perceivers, found)
        for name, figures in found.items():
            told[name] = figures.told()
            print(f"{name:40} {told[name]}", flush=True)
    return told


def follow(driven: FieldDrive, swing: float, perceivers: Sequence[str], found: dict[str, Figures]) -> None:
    """Add what comes of a drive."""
    ride = f"swing {swing:g}" if swing else "level"
    watches = [
        Watch(driven, one, Odometry(*errors), found.setdefault(f"{one}, {ride}{name}", Figures()))
        for one in perceivers
        for name, errors in ODOMETRIES.items()
    ]
    for number, frame in enumerate(driven.frames):
        for watch in watches:
            watch.take(number, frame)


def grid_cost(frames: int, *, beside: bool) -> dict[str, float]:
    """Return ms of CPU of an update and the reads after it. beside: after the built-in perceiver's turn."""
    driven = drive(0, 2.0, frames * 0.15, ("builtin",) if beside else ("truth",))
    grid, spent = LocalGrid(), list[float]()
    for frame in driven.frames:
        (maps,) = frame.maps.values()
        begun = time.process_time()
        pose = Pose(frame.pose.x, frame.pose.y, math.degrees(frame.pose.heading))
        grid.update(maps, CAMERA.leaning(*(frame.lean or (0.0, 0.0))), pose, frame.at)
        _ = grid.patch(REGION), grid.drivable, grid.known
        spent.append(1e3 * (time.process_time() - begun))
    end = "_beside" if beside else ""
    return {f"ms_p{share}{end}": round(float(np.percentile(spent, share)), 2) for share in (50, 95)}
