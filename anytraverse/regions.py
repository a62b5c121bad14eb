"""Defines regions of an image in fractions of its width and height, independent of its resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import RegionError

_SLIVER = 1e-6
Place = tuple[float, float]
"""x and y in fractions of the image's width and height; may lie outside of it."""
Corners = tuple[Place, Place, Place, Place]


@runtime_checkable
class Region(Protocol):
    """Describes a part of the image: a `Box`, or a `Quad`."""

    @property
    def corners(self) -> Corners:
        """The corners, clockwise, the first at the upper left; they may lie outside of the image."""

    @property
    def bounds(self) -> Box:
        """The smallest box around the region."""

    def mask(self, height: int, width: int) -> NDArray[np.bool_]:
        """Mark the pixels whose centre lies inside, (height, width); may be all False for a tiny region."""


@dataclass(frozen=True)
class Box:
    """Holds an axis-aligned box: left, top, right, bottom in [0, 1]; right > left, bottom > top.

    Raises RegionError for anything else.
    """

    left: float
    top: float
    right: float
    bottom: float

    def __post_init__(self) -> None:
        sides = (self.left, self.top, self.right, self.bottom)
        if not all(math.isfinite(side) and 0.0 <= side <= 1.0 for side in sides):
            raise RegionError(f"box {sides} has a side outside 0 to 1: give fractions of the image")
        if self.right <= self.left or self.bottom <= self.top:
            raise RegionError(f"box {sides} is empty: left < right and top < bottom are needed")

    @classmethod
    def around(cls, mask: NDArray[np.bool_]) -> Box | None:
        """Return the smallest box around the True pixels of a (height, width) mask; None without any."""
        height, width = mask.shape
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if len(rows) == 0:
            return None
        left, right = int(columns[0]) / width, int(columns[-1] + 1) / width
        return cls(left, int(rows[0]) / height, right, int(rows[-1] + 1) / height)

    @property
    def corners(self) -> Corners:
        """The corners, clockwise, the first at the upper left."""
        left, top, right, bottom = self.left, self.top, self.right, self.bottom
        return (left, top), (right, top), (right, bottom), (left, bottom)

    @property
    def bounds(self) -> Box:
        """The box itself."""
        return self

    @property
    def centre(self) -> tuple[float, float]:
        """(x, y) as fractions."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def mask(self, height: int, width: int) -> NDArray[np.bool_]:
        """Mark the pixels whose centre lies inside, (height, width)."""
        mask = np.zeros((height, width), dtype=np.bool_)
        mask[self.slices(height, width)] = True
        return mask

    def slices(self, height: int, width: int) -> tuple[slice, slice]:
        """Return the rows and columns whose pixel centres lie inside; empty slices when there are none."""
        rows = slice(math.ceil(self.top * height - 0.5), math.ceil(self.bottom * height - 0.5))
        columns = slice(math.ceil(self.left * width - 0.5), math.ceil(self.right * width - 0.5))
        return rows, columns

    def grown(self, factor: float) -> Box:
        """Return this box with its sides scaled about the centre by `factor` > 0, cut at the image's edge."""
        aside = (factor - 1.0) / 2 * (self.right - self.left)
        upright = (factor - 1.0) / 2 * (self.bottom - self.top)
        return Box(
            max(0.0, self.left - aside),
            max(0.0, self.top - upright),
            min(1.0, self.right + aside),
            min(1.0, self.bottom + upright),
        )

    def joined(self, other: Box | None) -> Box:
        """Return the smallest box around both; this box for None."""
        if other is None:
            return self
        return Box(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )

    def contains(self, x: float, y: float) -> bool:
        """Return whether the point (x, y), in fractions, is inside or on the edge."""
        return self.left <= x <= self.right and self.top <= y <= self.bottom


@dataclass(frozen=True)
class Quad:
    """Holds a convex quadrilateral: its corners clockwise, the first at its upper left."""

    corners: Corners

    @property
    def bounds(self) -> Box:
        """The box around what of it lies in the image; one without a pixel where nothing of it does."""
        (left, right), (top, bottom) = (_within(side) for side in zip(*self.corners, strict=True))
        return Box(left, top, right, bottom)

    def mask(self, height: int, width: int) -> NDArray[np.bool_]:
        """Mark the pixels whose centre lies inside, (height, width)."""
        return _mask(self, height, width)


def _within(sides: tuple[float, ...]) -> tuple[float, float]:
    low, high = (min(1.0, max(0.0, side)) for side in (min(sides), max(sides)))
    return (
        (low, high) if high - low >= _SLIVER else (min(low, 1.0 - _SLIVER), min(low, 1.0 - _SLIVER) + _SLIVER)
    )


@lru_cache(4)
def _mask(quad: Quad, height: int, width: int) -> NDArray[np.bool_]:
    x, y = (np.arange(width) + 0.5) / width, ((np.arange(height) + 0.5) / height)[:, np.newaxis]
    inside = np.ones((height, width), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(quad.corners, (*quad.corners[1:], quad.corners[0]), strict=True):
        inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0
    inside.flags.writeable = False
    return inside


@dataclass(frozen=True)
class TileScale:
    """Says how large an upright square on the ground appears: by how far its foot is below a row.

    horizon: that row. slope: the square's width over the image's width, for each image height below it.
    """

    horizon: float
    slope: float

    def side(self, row: float) -> float:
        """Return the width of the square whose foot is on this row, over the image's width; at least 0."""
        return max(0.0, self.slope * (row - self.horizon))
