"""What closes the view: sky with clouds, wooded hills at the horizon, the wall of trees round a forest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from companion.field import tiles
from companion.field.ground import Ground
from companion.field.trail import Pose

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

SKY, WOODS = range(2)  # the backdrop's own labels
HAZE = (196, 206, 212)  # the colour that distance takes on

_WIDTH = 2048  # columns of the panorama, all round
_PER_DEGREE = _WIDTH / 360
_ROWS = 300  # of the panorama, from the horizon up
_DRIFT = 0.35  # degrees a second that the clouds move
_RINGS = (14.0, 22.0, 32.0)  # m, where the woods are looked for
_CROWN = 9.0  # m above the camera's eye that the woods reach


class Backdrop:
    """Paints the part of the picture above the ground: (H, W) pixels of known direction."""

    def __init__(self, seed: int, azimuth: Floats, elevation: Floats) -> None:
        """`azimuth` (left positive) and `elevation` are (H, W), radians, of a camera that looks along +x."""
        rng = np.random.default_rng([seed, 20])
        self._column = np.degrees(azimuth) * np.float32(_PER_DEGREE)
        degrees = np.degrees(elevation)
        self._elevation = degrees
        self._sky, self._woods, self._raggedness = _sky(rng), _woods(rng), _raggedness(rng)
        rows = len(self._sky)
        self._row = np.clip(degrees * _PER_DEGREE, 0, rows - 1).astype(np.int32)
        self._hills = _hills(rng)
        self._bearing = azimuth[-1]  # of each column, at the horizon

    def look(self, pose: Pose, t: float, ground: Ground) -> tuple[Bytes, Bytes]:
        """Colours (H, W, 3) in full light and labels (H, W) from a pose at a time in s."""
        turn = np.degrees(pose.heading) * _PER_DEGREE
        column = (self._column + np.float32(turn)).astype(np.int32) & (_WIDTH - 1)
        drift = round(t * _DRIFT * _PER_DEGREE)
        at = self._row * _WIDTH
        sky = np.take(self._sky.ravel(), at + ((column + drift) & (_WIDTH - 1)))
        packed = np.take(self._woods.ravel(), at + column)
        ragged = np.take(self._raggedness.ravel(), at + column)

        wall = self._wall(pose, ground)
        far = np.take(self._hills, column)
        near = wall[None, :] + ragged * (0.35 * wall)[None, :] - 1.0 > self._elevation
        hill = far > self._elevation
        colours = np.where(near | hill, packed, sky).view(np.uint8).reshape(*column.shape, 4)[..., :3]
        hazy = (hill & ~near)[..., None]
        blend = (colours.astype(np.uint16) * 92 + np.asarray(HAZE, np.uint16) * 164) >> 8
        colours = np.where(hazy, blend.astype(np.uint8), colours)
        return colours, (near | hill).astype(np.uint8) * np.uint8(WOODS)

    def _wall(self, pose: Pose, ground: Ground) -> Floats:
        """How high the woods stand in each column, in degrees: high where forest lies in that direction."""
        bearing = (self._bearing + pose.heading)[None, :]
        ring = np.asarray(_RINGS, np.float32)[:, None]
        x = (pose.x + ring * np.cos(bearing)).astype(np.float32)
        y = (pose.y + ring * np.sin(bearing)).astype(np.float32)
        forest, _ = ground.shares(x, y)
        height: Floats = (forest * np.degrees(np.arctan(_CROWN / ring))).max(axis=0).astype(np.float32)
        return height


def _pack(colours: NDArray[np.float32]) -> NDArray[np.uint32]:
    four = np.zeros((*colours.shape[:2], 4), np.uint8)
    four[..., :3] = np.clip(colours, 0, 255)
    return four.view(np.uint32)[..., 0]


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
    base = np.array([38, 52, 30]) * (1 - up) + np.array([66, 88, 44]) * up
    colours = base * (1 + 0.3 * leaves[..., None])
    trunk = _panorama_noise(rng, 4, 24, 1)[0]
    bark = ((trunk > 0.9)[None, :] & (np.arange(rows) < 90)[:, None] & (leaves < 0.7))[..., None]
    return _pack(np.where(bark, np.array([52, 44, 36]) * (1 + 0.15 * leaves[..., None]), colours))


def _raggedness(rng: np.random.Generator) -> Floats:
    return 0.6 * _panorama_noise(rng, 5, 40) + 0.5 * _panorama_noise(rng, 40, 300)


def _hills(rng: np.random.Generator) -> Floats:
    """The height of the hills in each column of the panorama, in degrees."""
    slow, fine = _panorama_noise(rng, 150, 1000, 1)[0], _panorama_noise(rng, 4, 30, 1)[0]
    heights: Floats = np.clip(2.6 + 1.1 * slow + 0.25 * fine, 0.8, 6.0).astype(np.float32)
    return heights
