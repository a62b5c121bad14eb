"""Draws the ground as a camera sees it: material, colour and shade; its texture is fixed to the world."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.sim.field import tiles
from companion.sim.field.lens import SimulatedLens
from companion.sim.field.things import World
from companion.sim.field.trail import ZONES, TrailPose

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

GRASS, PATH, GRAVEL = range(3)  # the ground's own labels
_LABELS = np.array([GRASS, GRASS, GRASS, PATH, PATH, GRAVEL], np.uint8)  # of the materials of tiles.py

_MARGIN = 38.0  # m around the route that the maps cover; beyond it their edge is repeated
_FOREST_ENDS = 26.0, 36.0  # m from the route, where forest and gravel give way to meadow
_CELL = 0.5  # m, the side of a cell of the route map
_SHADE_CELL = 0.1  # m, the side of a cell of the shadow map
_NOISE_SIZE, _NOISE_TEXEL = 1024, 0.02  # the ragged edges, patches and light spots
_SUN = (0.75, -0.66)  # where shadows fall, as a direction on the ground
_RUT, _RUT_WIDTH = 0.62, 0.17  # m from the centre line; m
_CANOPY = 0.46  # share of the light that a forest's crowns take
_SHADOW = {
    "bush": (1.0, 0.55),
    "tree": (2.2, 0.4),
    "drum": (1.3, 0.5),
    "rock": (1.1, 0.5),
    "log": (1.1, 0.45),
}


class Footing(NamedTuple):
    """Where the pixels of a lens meet the ground, m ahead and to the left, and the scales of tiles there."""

    forward: Floats
    left: Floats
    levels: tuple[tuple[NDArray[np.int32], ...], ...]


class Ground:
    """Samples a world's ground at points. Maps are drawn once, shadows again when the world changes."""

    def __init__(self, world: World) -> None:
        rng = np.random.default_rng([world.seed, 10])
        self._world = world
        self._materials = tiles.Mips(np.stack(tiles.materials(rng)), tiles.TEXEL)
        field = np.stack(
            [
                tiles.as_bytes(tiles.noise(rng, _NOISE_SIZE, _NOISE_SIZE, a, b))
                for a, b in ((4, 40), (50, 220), (18, 60), (90, 500))
            ],
            axis=-1,
        )
        self._noise = tiles.Mips(field[None], _NOISE_TEXEL)
        low, high = world.trail.points.min(axis=0) - _MARGIN, world.trail.points.max(axis=0) + _MARGIN
        self._corner, self._extent = low, high - low
        self._route = _route_map(world, low, high)
        self._shadows, self._drawn = np.zeros((0, 0), np.uint8), -1
        self.points: tuple[Floats, ...] = ()  # world coordinates of the pixels at the last call of `look`

    def footing(self, lens: SimulatedLens) -> Footing:
        levels = self._materials.level(lens.footprint), self._noise.level(lens.footprint)
        return Footing(lens.forward, lens.left, levels)

    def look(self, pose: TrailPose, footing: Footing) -> tuple[Bytes, Bytes, Floats]:
        """Returns colours (H, W, 3) in full light, labels (H, W) and brightness (H, W; 1 = full light)."""
        if self._drawn != self._world.revision:
            self._shadows, self._drawn = self._draw_shadows(), self._world.revision
        c, s = np.float32(np.cos(pose.heading)), np.float32(np.sin(pose.heading))
        x = footing.forward * c - footing.left * s + np.float32(pose.x)
        y = footing.forward * s + footing.left * c + np.float32(pose.y)
        self.points = x, y
        away, half, forest, gravel = self._read_route(x, y)
        field = self._noise.read(x, y, footing.levels[1])
        edge, patch, spots, tone = (
            field[..., i].astype(np.float32) * np.float32(1 / 40) - 3.2 for i in range(4)
        )

        lateral = np.abs(away)
        ragged = np.clip(0.2 * patch + 0.08 * edge, -0.45, 0.45)
        zone = np.where(forest + ragged > 0.5, 1, np.where(gravel + ragged > 0.5, 2, 0)).astype(np.int32)
        on_path = lateral + 0.1 * edge + 0.06 * patch < half
        strip = 0.26 + 0.14 * edge - 0.3 * (1 + tone)  # of grass between the ruts, where it grows at all
        on_path &= (lateral > np.minimum(strip, 0.45)) | (zone > 0)
        material = zone + 3 * on_path
        colours = self._materials.read(x, y, footing.levels[0], material)[..., :3]

        light = 1 + 0.07 * tone + 0.04 * patch
        rut = (lateral - _RUT - 0.04 * edge) * (1 / _RUT_WIDTH)
        light -= on_path * (0.26 - 0.12 * gravel) * np.exp(-rut * rut)
        light *= 1 - _CANOPY * forest * (1 - 0.75 * np.clip(spots - 0.75, 0, 1))
        return colours, _LABELS[material], light * self._read_shadows(x, y)

    def shares(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Returns the shares of forest and of gravel (0..1) at points; arrays of at least two dimensions."""
        _, _, forest, gravel = self._read_route(x, y)
        return forest, gravel

    def light_on(self, x: float, y: float) -> float:
        """Returns the brightness of a thing at a place: 1 in the open, less under trees."""
        forest, _ = self.shares(np.full((1, 1), x, np.float32), np.full((1, 1), y, np.float32))
        return 1.0 - 0.3 * float(forest[0, 0])

    def _read_route(self, x: Floats, y: Floats) -> list[Floats]:
        import cv2

        column = (x - np.float32(self._corner[0])) * np.float32(1 / _CELL)
        row = (y - np.float32(self._corner[1])) * np.float32(1 / _CELL)
        read = cv2.remap(self._route, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return [np.asarray(channel, np.float32) for channel in cv2.split(read)]

    def _read_shadows(self, x: Floats, y: Floats) -> Floats:
        import cv2

        column = (x - np.float32(self._corner[0])) * np.float32(1 / _SHADE_CELL)
        row = (y - np.float32(self._corner[1])) * np.float32(1 / _SHADE_CELL)
        read = cv2.remap(
            self._shadows, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255
        )
        return read.astype(np.float32) * np.float32(1 / 255)

    def _draw_shadows(self) -> Bytes:
        import cv2

        width, height = (self._extent / _SHADE_CELL).astype(int)
        lit = np.full((height, width), 255, np.uint8)
        for thing in list(self._world.things.values()):
            if thing.kind not in _SHADOW:
                continue
            long, dark = _SHADOW[thing.kind]
            centre = np.array([thing.x, thing.y]) + np.asarray(_SUN) * thing.radius * 0.5 * long
            angle = math.atan2(_SUN[1], _SUN[0])
            axes = thing.radius * (0.7 + 0.5 * long), thing.radius * 1.05
            if thing.length:
                angle, axes = thing.heading, (thing.length / 2, thing.radius * 1.6)
            column, row = ((centre - self._corner) / _SHADE_CELL).astype(int)
            reach = math.ceil(max(axes) / _SHADE_CELL) + 2
            if not (reach <= column < width - reach and reach <= row < height - reach):
                continue
            stain = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
            box = (reach, reach), (2 * axes[0] / _SHADE_CELL, 2 * axes[1] / _SHADE_CELL), math.degrees(angle)
            cv2.ellipse(stain, box, int(255 * dark), -1)
            patch = lit[row - reach : row + reach + 1, column - reach : column + reach + 1]
            np.minimum(patch, 255 - stain, out=patch)
        return np.asarray(cv2.GaussianBlur(lit, (0, 0), 1.3), np.uint8)


def _route_map(world: World, low: NDArray[np.float64], high: NDArray[np.float64]) -> Floats:
    """Makes the route map (rows, columns, 4): lateral offset, half width (m); forest, gravel (0..1)."""
    import cv2

    trail = world.trail
    line = trail.points[::4]
    stations = np.arange(len(line)) * trail.length / len(trail.points) * 4
    xs, ys = np.arange(low[0], high[0], _CELL), np.arange(low[1], high[1], _CELL)
    ahead = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    ahead /= np.hypot(*ahead.T)[:, None]
    rows = []
    for y in ys:
        dx, dy = xs[:, None] - line[:, 0], y - line[:, 1]
        near = np.argmin(dx * dx + dy * dy, axis=1)
        at = np.arange(len(xs))
        ex, ey = dx[at, near], dy[near]
        tx, ty = ahead[near].T
        side = np.sign(tx * ey - ty * ex)
        lateral = side * np.hypot(np.abs(tx * ey - ty * ex), np.maximum(0, np.abs(tx * ex + ty * ey) - 0.3))
        s = (stations[near] + tx * ex + ty * ey) % trail.length
        begins, ends = _FOREST_ENDS
        shares = trail.shares(s) * np.clip((ends - np.abs(lateral)) / (ends - begins), 0, 1)[:, None]
        rows.append(
            np.stack(
                [
                    lateral,
                    trail.half_width(s),
                    shares[:, ZONES.index("forest")],
                    shares[:, ZONES.index("gravel")],
                ],
                -1,
            )
        )
    route = np.asarray(rows, np.float32)
    route[..., 2:] = cv2.GaussianBlur(route[..., 2:], (0, 0), 1.2 / _CELL)
    return route
