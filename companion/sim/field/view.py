"""Turns and distorts the picture of a lens as a camera's on a rover that leans, and tells where it looks."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from companion.sim.field.lens import FARTHEST, STANDARD, Floats, LensMount, SimulatedLens, focal_length
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.trail import TrailPose

Doubles = NDArray[np.float64]

_LEAST_STRETCH = 0.25  # of a distorted by an undistorted picture, outwards; nearer to 0 nothing is drawn


class View:
    """A camera of a mount on a rover, which leans by `tilt` against the ground.

    A camera that looks down and rolls also looks aside. So it has the picture of a `lens` without roll, `yaw`
    rad to the left of the rover, turned about the optical axis. That is exact, and leans things as well.
    k1: of OpenCV's radial distortion; the focal length is as without it. Where a barrel ends before the
    picture does (at 4:3 below -0.15), the pixels beyond repeat the last that see something.
    """

    def __init__(
        self, width: int, height: int, tilt: Tilt = LEVEL, k1: float = 0.0, mount: LensMount = STANDARD
    ) -> None:
        self._size, self._k1 = (width, height), k1
        self.yaw, self._down, self._turn = _camera_angles(tilt, mount.pitch)
        self._mount = LensMount(mount.height, self._down)
        self.focal = focal_length(width)
        self.table: tuple[Floats, Floats] | None = None  # for cv2.remap: from the lens's picture to this one
        if not (tilt.roll or k1):
            self.lens = SimulatedLens(width, height, self._mount)
            return
        import cv2

        places = _undistorted(width, height, k1)[0].astype(np.float32)
        table = np.asarray(cv2.transform(places, self._turned() * self.focal), np.float32)
        reach = np.abs(np.vstack([*table[[0, -1]], *table[:, [0, -1]]])).max(axis=0)  # at the four sides
        wide, high = (2 * math.ceil(axis) + 2 for axis in reach)
        self.lens = SimulatedLens(wide, high, self._mount, self.focal)
        self.table = table[..., 0] + np.float32((wide - 1) / 2), table[..., 1] + np.float32((high - 1) / 2)

    def project(self, pose: TrailPose, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Projects a point (m) at a rover's pose: returns column, row, both NaN if unseen, and depth in m."""
        column, row, depth = self.lens.project(TrailPose(pose.x, pose.y, pose.heading + self.yaw), x, y, z)
        if self.table is None or depth <= 0:
            return column, row, depth
        right, down = (column - self.lens.width / 2) / self.focal, (row - self.lens.height / 2) / self.focal
        c, s = math.cos(self._turn), math.sin(self._turn)
        right, down = right * c + down * s, down * c - right * s
        stretch = 1 + self._k1 * (right * right + down * down)
        if math.hypot(right, down) > _last_ray(self._k1):
            return math.nan, math.nan, depth
        width, height = self._size
        return width / 2 + self.focal * right * stretch, height / 2 + self.focal * down * stretch, depth

    def where(self) -> tuple[Floats, Floats]:
        """Returns how many metres ahead and to the left of the rover each pixel (H, W) meets the ground.

        NaN where it does not. What stands on the ground does not count. It is at most FARTHEST away.
        """
        places, seen = _undistorted(*self._size, self._k1)
        x, y = np.moveaxis(places @ self._turned().T, 2, 0)
        drop = math.sin(self._down) + y * math.cos(self._down)
        above = self._mount.height
        depth = np.where(seen & (drop > 0), above / np.maximum(drop, above / FARTHEST), np.nan)
        ahead, left = (math.cos(self._down) - y * math.sin(self._down)) * depth, -x * depth
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return (ahead * c - left * s).astype(np.float32), (ahead * s + left * c).astype(np.float32)

    def _turned(self) -> Doubles:
        """Returns the rotation of places in this picture to those in the lens's."""
        c, s = math.cos(self._turn), math.sin(self._turn)
        return np.array([[c, -s], [s, c]])


def _camera_angles(tilt: Tilt, mount: float) -> tuple[float, float, float]:
    """Returns the camera's angles: left of the rover, down from the horizon, and its roll; rad.

    They are those of a rotation by pitch, then roll, then the mount's pitch, `mount`.
    """
    if not tilt.roll:
        return 0.0, mount - tilt.pitch, 0.0
    ahead, down = math.cos(mount), math.sin(mount) * math.cos(tilt.roll)
    right = -math.sin(mount) * math.sin(tilt.roll)
    c, s = math.cos(tilt.pitch), math.sin(tilt.pitch)
    ahead, down = ahead * c + down * s, down * c - ahead * s
    turn = math.asin(math.sin(tilt.roll) * c / math.hypot(ahead, right))
    return math.atan2(-right, ahead), math.asin(down), turn


def _last_ray(k1: float) -> float:
    """Returns how far from the middle the last ray meets the picture without distortion, in focal lengths."""
    return math.sqrt((1 - _LEAST_STRETCH) / (-3 * k1)) if k1 < 0 else math.inf


@lru_cache(maxsize=8)
def _undistorted(width: int, height: int, k1: float) -> tuple[Doubles, NDArray[np.bool_]]:
    """Returns where each pixel would be without distortion: (H, W, 2), from the middle, in focal lengths.

    Also whether it sees anything; where not, the place is that of the last ray in its direction.
    """
    focal = focal_length(width)
    across, down = ((np.arange(size) + 0.5 - size / 2) / focal for size in (width, height))
    places = np.stack(np.meshgrid(across, down), axis=-1)
    out = np.hypot(places[..., 0], places[..., 1])
    if not k1:
        return places, np.ones_like(out, bool)
    last = _last_ray(k1)
    farthest = last * (1 + k1 * last * last) if k1 < 0 else math.inf
    wanted = np.minimum(out, farthest)
    ray = wanted.copy()
    for _ in range(20):  # Newton's method: from here it never passes the root
        ray -= (ray + k1 * ray**3 - wanted) / (1 + 3 * k1 * ray * ray)
    return places * (ray / np.maximum(out, 1e-9))[..., None], out <= farthest
