"""Computes where each pixel of a camera over level ground looks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.sim.field.trail import Pose

Floats = NDArray[np.float32]

HEIGHT = 1.0  # m from the ground to the lens
PITCH = math.radians(7.0)  # rad from the horizon down to the optical axis
FIELD_OF_VIEW = math.radians(75.0)  # rad, horizontal
_FARTHEST = 300.0  # m; without it the row at the horizon would be infinitely far


class Lens:
    """A pinhole camera without distortion, HEIGHT above the ground, looking along a heading and PITCH down.

    `forward` and `left` (m along and across the heading) and `footprint` (m of ground that a pixel covers)
    have the shape (height - horizon, width): the rows from `horizon` on see the ground.
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
        """Returns azimuth (left positive) and elevation of the first rows' pixels: (rows, width), radians."""
        ahead, drop = self._ahead[:rows, None], self._drop[:rows, None]
        azimuth = np.arctan2(-self._across, ahead)
        elevation = np.arctan2(-drop, np.hypot(self._across, ahead))
        return azimuth.astype(np.float32), elevation.astype(np.float32)

    def project(self, pose: Pose, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Projects a point (m): returns column and row in pixels, NaN behind the lens, and its depth in m."""
        ahead, left = relative(pose, x, y)
        depth = ahead * math.cos(PITCH) + (HEIGHT - z) * math.sin(PITCH)
        if depth <= 0:
            return math.nan, math.nan, depth
        down = (HEIGHT - z) * math.cos(PITCH) - ahead * math.sin(PITCH)
        return self.width / 2 - self.focal * left / depth, self.height / 2 + self.focal * down / depth, depth


def relative(pose: Pose, x: float, y: float) -> tuple[float, float]:
    """Returns how many metres ahead and to the left of a pose a point is."""
    dx, dy = x - pose.x, y - pose.y
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    return dx * c + dy * s, dy * c - dx * s
