"""The geometry of a camera over level ground: which pixel looks where."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.sim.field.trail import Pose

Floats = NDArray[np.float32]

HEIGHT = 1.0  # m of the lens above the ground
PITCH = math.radians(7.0)  # of the axis below the horizon
FIELD_OF_VIEW = math.radians(75.0)  # horizontal
_FARTHEST = 300.0  # m; the row at the horizon would see for ever


class Lens:
    """A pinhole without distortion, HEIGHT above the ground, that looks along a heading and PITCH down.

    `forward` and `left` (m along and across the heading) and `footprint` (m of ground a pixel covers) are
    (height - horizon, width), for the rows from `horizon` on, which see the ground.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.focal = width / 2 / math.tan(FIELD_OF_VIEW / 2)  # pixels
        self._across = (np.arange(width) + 0.5 - width / 2) / self.focal
        down = (np.arange(height) + 0.5 - height / 2) / self.focal
        self._ahead = math.cos(PITCH) - down * math.sin(PITCH)
        self._drop = math.sin(PITCH) + down * math.cos(PITCH)
        self.horizon = int(np.count_nonzero(self._drop <= 0))
        depth = HEIGHT / np.maximum(self._drop[self.horizon :], HEIGHT / _FARTHEST)
        shape = depth.size, width
        self.forward = np.broadcast_to((self._ahead[self.horizon :] * depth)[:, None], shape).astype(
            np.float32
        )
        self.left = (-self._across * depth[:, None]).astype(np.float32)
        footprint = depth * np.sqrt(depth / HEIGHT) / self.focal
        self.footprint = np.broadcast_to(footprint[:, None], shape).astype(np.float32)

    def directions(self, rows: int) -> tuple[Floats, Floats]:
        """Azimuth (left positive) and elevation of the first rows' pixels, (rows, width), in radians."""
        ahead, drop = self._ahead[:rows, None], self._drop[:rows, None]
        azimuth = np.arctan2(-self._across, ahead)
        elevation = np.arctan2(-drop, np.hypot(self._across, ahead))
        return azimuth.astype(np.float32), elevation.astype(np.float32)

    def project(self, pose: Pose, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Where a point (m) falls: column and row in pixels, and its depth in m (NaN pixels when <= 0)."""
        ahead, left = relative(pose, x, y)
        depth = ahead * math.cos(PITCH) + (HEIGHT - z) * math.sin(PITCH)
        if depth <= 0:
            return math.nan, math.nan, depth
        down = (HEIGHT - z) * math.cos(PITCH) - ahead * math.sin(PITCH)
        return self.width / 2 - self.focal * left / depth, self.height / 2 + self.focal * down / depth, depth


def relative(pose: Pose, x: float, y: float) -> tuple[float, float]:
    """A point as a pose sees it: metres ahead and metres to the left."""
    dx, dy = x - pose.x, y - pose.y
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    return dx * c + dy * s, dy * c - dx * s
