"""Computes where each pixel of a camera over level ground looks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.sim.field.trail import TrailPose

Floats = NDArray[np.float32]

HEIGHT = 1.0  # m from the ground to the lens
PITCH = math.radians(7.0)  # rad from the horizon down to the optical axis
FIELD_OF_VIEW = math.radians(75.0)  # rad, horizontal
FARTHEST = 300.0  # m; without it the row at the horizon would be infinitely far


class LensMount(NamedTuple):
    """Where a lens is: m above the ground, and rad from the horizon down to its optical axis."""

    height: float = HEIGHT
    pitch: float = PITCH


STANDARD = LensMount()


class SimulatedLens:
    """A pinhole camera without roll or distortion that looks along a heading and down.

    `forward` and `left` (m along and across the heading) have the shape (height - horizon, width), and
    `footprint` (m of ground that a pixel covers) one column: the rows from `horizon` on see the ground.
    """

    def __init__(
        self, width: int, height: int, mount: LensMount = STANDARD, focal: float | None = None
    ) -> None:
        """focal: pixels; None: as FIELD_OF_VIEW needs it."""
        self.width, self.height, self.mount = width, height, mount
        above, down = mount
        self.focal = focal_length(width) if focal is None else focal  # pixels
        self._across = (np.arange(width) + 0.5 - width / 2) / self.focal
        row = (np.arange(height) + 0.5 - height / 2) / self.focal
        self._ahead = math.cos(down) - row * math.sin(down)
        self._drop = math.sin(down) + row * math.cos(down)
        self.horizon = int(np.count_nonzero(self._drop <= 0))
        depth = above / np.maximum(self._drop[self.horizon :], above / FARTHEST)
        shape = depth.size, width
        self.forward = np.broadcast_to((self._ahead[self.horizon :] * depth)[:, None], shape).astype(
            np.float32
        )
        self.left = (-self._across * depth[:, None]).astype(np.float32)
        footprint = depth * np.sqrt(depth / above) / self.focal
        self.footprint = footprint[:, None].astype(np.float32)

    def directions(self, rows: int) -> tuple[Floats, Floats]:
        """Returns azimuth (left positive) and elevation of the first rows' pixels: (rows, width), radians."""
        ahead, drop = self._ahead[:rows, None], self._drop[:rows, None]
        azimuth = np.arctan2(-self._across, ahead)
        elevation = np.arctan2(-drop, np.hypot(self._across, ahead))
        return azimuth.astype(np.float32), elevation.astype(np.float32)

    def project(self, pose: TrailPose, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Projects a point (m): returns column and row in pixels, NaN behind the lens, and its depth in m."""
        ahead, left = relative(pose, x, y)
        above, pitch = self.mount
        c, s = math.cos(pitch), math.sin(pitch)
        depth = ahead * c + (above - z) * s
        if depth <= 0:
            return math.nan, math.nan, depth
        down = (above - z) * c - ahead * s
        return self.width / 2 - self.focal * left / depth, self.height / 2 + self.focal * down / depth, depth


def focal_length(width: int) -> float:
    """Returns the focal length in pixels of a picture that is so many pixels and FIELD_OF_VIEW wide."""
    return width / 2 / math.tan(FIELD_OF_VIEW / 2)


def relative(pose: TrailPose, x: float, y: float) -> tuple[float, float]:
    """Returns how many metres ahead and to the left of a pose a point is."""
    dx, dy = x - pose.x, y - pose.y
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    return dx * c + dy * s, dy * c - dx * s
