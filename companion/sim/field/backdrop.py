"""Paints the background: sky with clouds, wooded hills at the horizon, the wall of trees round a forest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.sim.field import tiles
from companion.sim.field.ground import Ground
from companion.sim.field.trail import TrailPose

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

HAZE = (196, 206, 212)  # the colour that distance takes on

_WIDTH = 2048  # columns of the panorama, all round
_PER_DEGREE = _WIDTH / 360
_HIGHEST_HILL = 6.0  # degrees
_ROWS = 300  # of the panorama, from the horizon up
_DRIFT = 0.35  # degrees a second that the clouds move
_RINGS = (14.0, 22.0, 32.0, 44.0)  # m from the camera, distances at which the ground is sampled for woods
NEAREST_FOOT = _RINGS[1]  # m, before which the ground stays open
_CROWN = 9.0  # m that the woods reach above the lens


class Outlook:
    """The directions in which the upper rows of a frame look, as `Backdrop` needs them."""

    def __init__(self, azimuth: Floats, elevation: Floats) -> None:
        """`azimuth` (left positive) and `elevation` are (H, W) in radians, of a camera that looks along +x.

        The rows reach as far below the horizon as woods may stand.
        """
        self.column = np.degrees(azimuth) * np.float32(_PER_DEGREE)
        self.elevation = np.degrees(elevation)
        self.pixels = np.float32(
            len(elevation) / np.degrees(elevation[0, 0] - elevation[-1, 0])
        )  # in a degree
        self.row = np.clip(np.abs(self.elevation) * _PER_DEGREE, 0, _ROWS - 1).astype(np.int32)
        highest = elevation.max(axis=1)
        self.horizon = int(np.searchsorted(-highest, 0.0))
        self.hills_from = int(np.searchsorted(-highest, -math.radians(_HIGHEST_HILL)))
        self.bearing = azimuth[max(0, self.horizon - 1)]  # of each column


class Backdrop:
    """Paints what is behind the things over the upper rows of a frame."""

    def __init__(self, seed: int, labels: tuple[int, int]) -> None:
        """`labels`: the label ids of sky and woods."""
        rng = np.random.default_rng([seed, 20])
        self._labels = labels
        self._sky, self._woods, self._ragged, self._hills = (
            _sky(rng),
            _woods(rng),
            _raggedness(rng),
            _hills(rng),
        )

    def paint(
        self, frame: Bytes, labels: Bytes, outlook: Outlook, pose: TrailPose, t: float, ground: Ground
    ) -> None:
        """Paints in full light over a frame (rows, W, 3) with its ground drawn and over its labels (rows, W).

        t: s, by which the clouds have drifted.
        """
        import cv2

        turn = np.float32(np.degrees(pose.heading) * _PER_DEGREE)
        column = (outlook.column + turn).astype(np.int32) & (_WIDTH - 1)
        drift = round(t * _DRIFT * _PER_DEGREE)
        at = outlook.row * _WIDTH
        above = slice(0, outlook.horizon)
        if outlook.horizon:
            frame[above] = _unpack(np.take(self._sky, at[above] + ((column[above] + drift) & (_WIDTH - 1))))
        labels[above] = self._labels[0]
        at += column
        woods = _unpack(np.take(self._woods, at))

        if outlook.hills_from < outlook.horizon:
            low = slice(outlook.hills_from, outlook.horizon)
            rise = (np.take(self._hills, column[low]) - outlook.elevation[low]) * outlook.pixels
            air = np.full_like(woods[low], HAZE)
            hills = np.asarray(cv2.addWeighted(woods[low], 0.36, air, 0.64, 0), np.uint8)
            self._cover(frame[low], labels[low], hills, rise)
        crown, foot = self._woods_around(outlook.bearing + pose.heading, pose, ground)
        if crown.max() > 1:
            ragged = np.take(self._ragged, at)
            over = crown * (1 + np.float32(0.35) * ragged) - np.float32(1) - outlook.elevation
            under = outlook.elevation + foot * (1 + np.float32(0.2) * ragged)
            self._cover(frame, labels, woods, np.minimum(over * np.float32(0.6), under) * outlook.pixels)

    def _cover(self, frame: Bytes, labels: Bytes, woods: Bytes, rise: Floats) -> None:
        """Paints woods where they reach above a pixel, `rise` pixels high; the edge is one pixel soft."""
        import cv2

        shown = np.clip(rise + np.float32(0.5), 0, 1)
        frame[:] = cv2.blendLinear(frame, woods, 1 - shown, shown)
        labels[shown > 0.5] = self._labels[1]

    def _woods_around(self, bearing: Floats, pose: TrailPose, ground: Ground) -> tuple[Floats, Floats]:
        """Returns how far above and below the horizon the woods reach at bearings (rad), in degrees."""
        ring = np.asarray(_RINGS, np.float32)[:, None]
        x = (pose.x + ring * np.cos(bearing[None, :])).astype(np.float32)
        y = (pose.y + ring * np.sin(bearing[None, :])).astype(np.float32)
        forest, _ = ground.shares(x, y)
        crown = (forest * np.degrees(np.arctan(_CROWN / ring))).max(axis=0)
        beyond = slice(1, None)  # without the nearest ring, so that no foot of the woods covers the path
        foot = (forest * np.degrees(np.arctan(1 / ring)))[beyond].max(axis=0)
        return crown.astype(np.float32), foot.astype(np.float32)


def _pack(colours: NDArray[np.float32]) -> NDArray[np.uint32]:
    four = np.zeros((*colours.shape[:2], 4), np.uint8)
    four[..., :3] = np.clip(colours, 0, 255)
    return four.view(np.uint32)[..., 0]


def _unpack(packed: NDArray[np.uint32]) -> Bytes:
    import cv2

    four = packed.view(np.uint8).reshape(*packed.shape, 4)
    return np.asarray(cv2.cvtColor(four, cv2.COLOR_RGBA2RGB), np.uint8)


def _panorama_noise(rng: np.random.Generator, shortest: float, longest: float, rows: int = _ROWS) -> Floats:
    return tiles.noise(rng, rows, _WIDTH, shortest, longest)


def _sky(rng: np.random.Generator) -> NDArray[np.uint32]:
    cloud = _panorama_noise(rng, 24, 400) + 0.35 * _panorama_noise(rng, 6, 40)
    rows = len(cloud)
    up = np.linspace(0, 1, rows, dtype=np.float32)[:, None, None] ** 0.7
    blue = np.array([206, 221, 233]) * (1 - up) + np.array([104, 150, 208]) * up
    white = np.clip((cloud - 0.35) * 0.8, 0, 0.85)[..., None]
    shade = np.clip(238 - 14 * cloud, 205, 250)[..., None]
    return _pack(blue * (1 - white) + shade * white)


def _woods(rng: np.random.Generator) -> NDArray[np.uint32]:
    leaves = 0.6 * _panorama_noise(rng, 3, 14) + 0.7 * _panorama_noise(rng, 14, 80)
    rows = len(leaves)
    up = np.linspace(0, 1, rows, dtype=np.float32)[:, None, None]
    base = np.array([58, 68, 52]) * (1 - up) + np.array([88, 106, 68]) * up
    colours = base * (1 + 0.2 * leaves[..., None])
    trunk = _panorama_noise(rng, 4, 24, 1)[0]
    bark = ((trunk > 0.9)[None, :] & (np.arange(rows) < 90)[:, None] & (leaves < 0.7))[..., None]
    return _pack(np.where(bark, np.array([66, 62, 54]) * (1 + 0.12 * leaves[..., None]), colours))


def _raggedness(rng: np.random.Generator) -> Floats:
    leaves, crowns = _panorama_noise(rng, 2, 9), _panorama_noise(rng, 9, 40)
    ragged: Floats = 0.3 * leaves + 0.35 * crowns + 0.5 * _panorama_noise(rng, 40, 300)
    return ragged


def _hills(rng: np.random.Generator) -> Floats:
    """Returns the height of the hills in each column of the panorama, in degrees."""
    slow, fine = _panorama_noise(rng, 150, 1000, 1)[0], _panorama_noise(rng, 4, 30, 1)[0]
    heights: Floats = np.clip(2.6 + 1.1 * slow + 0.25 * fine, 0.8, _HIGHEST_HILL).astype(np.float32)
    return heights
