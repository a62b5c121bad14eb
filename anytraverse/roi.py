"""What stands in the region of interest, in figures."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from anytraverse.regions import Box, Region

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]

KNOWN = 0.5
"""A pixel is explained by a word when its attention reaches this."""

_STRAY = 0.1
"""Share of a corridor's width that may be not drivable: stray pixels, not things."""


@dataclass(frozen=True)
class Corridor:
    """The vehicle's width as fractions of the image's width, at the bottom and the top of the ROI."""

    bottom: float
    top: float


@dataclass(frozen=True)
class Tile:
    """A square window of the ROI and its mean uncertainty, in [0, 1]."""

    box: Box
    uncertainty: float


@dataclass(frozen=True)
class RoiFigures:
    """Figures of one frame's ROI.

    uncertainty, traversability: means over the ROI, in [0, 1].
    known_share: pixels that some word explains. drivable_share: the drivable ones of these, or None.
    corridor: whether the vehicle fits through; None when not judged.
    """

    uncertainty: float
    traversability: float
    known_share: float
    drivable_share: float | None
    corridor: bool | None
    worst_tile: Tile


def worst_tile(
    uncertainty: Map, region: Region, aspect: float, share: float = 0.25, outside: Box | None = None
) -> Tile | None:
    """The square window of the ROI whose mean uncertainty is highest.

    uncertainty: (h, w). aspect: width / height of the frame. share: the window's side over the ROI's width.
    outside: only pixels outside this box count, and windows of which they fill at least half.
    None when no window is left.
    """
    height, width = uncertainty.shape
    bounds = region.bounds
    rows, columns = bounds.slices(height, width)
    counted = region.mask(height, width)
    if outside is not None:
        counted = counted & ~outside.mask(height, width)
    counted = counted[rows, columns]
    values = np.where(counted, uncertainty[rows, columns], 0.0)
    if not counted.any():
        return None
    side = share * (bounds.right - bounds.left)
    tile_width = min(max(1, round(side * width)), counted.shape[1])
    tile_height = min(max(1, round(side * aspect * height)), counted.shape[0])
    sums = _window_sums(values, tile_height, tile_width)
    counts = _window_sums(counted.astype(np.float64), tile_height, tile_width)
    enough = counts >= 0.5 * tile_height * tile_width
    if not enough.any():
        return None
    means = np.where(enough, sums / np.maximum(counts, 1.0), -1.0)
    row, column = np.unravel_index(int(np.argmax(means)), means.shape)
    top, left = rows.start + int(row), columns.start + int(column)
    box = Box(left / width, top / height, (left + tile_width) / width, (top + tile_height) / height)
    return Tile(box, float(np.clip(means[row, column], 0.0, 1.0)))


def _window_sums(values: NDArray[np.floating], height: int, width: int) -> NDArray[np.float64]:
    table = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    table[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
    sums: NDArray[np.float64] = (
        table[height:, width:] - table[:-height, width:] - table[height:, :-width] + table[:-height, :-width]
    )
    return sums


def corridor_open(not_drivable: Mask, region: Region, corridor: Corridor) -> bool:
    """Whether a strip of the vehicle's width leads through the ROI from bottom to top.

    not_drivable: (h, w). The strip may shift by one pixel of the map a row, and bear stray pixels.
    """
    height, width = not_drivable.shape
    rows, columns = region.bounds.slices(height, width)
    blocked = not_drivable[rows, columns]
    count, across = blocked.shape
    reachable: Mask | None = None
    for row in range(count - 1, -1, -1):
        rise = (count - 1 - row) / max(1, count - 1)
        strip = round((corridor.bottom + (corridor.top - corridor.bottom) * rise) * width)
        strip = min(max(1, strip), across)
        sums = np.convolve(blocked[row], np.ones(strip), mode="valid")
        free = np.zeros(across, dtype=np.bool_)
        offset = strip // 2
        free[offset : offset + len(sums)] = sums <= _STRAY * strip
        if reachable is not None:
            spread = reachable.copy()
            spread[1:] |= reachable[:-1]
            spread[:-1] |= reachable[1:]
            free &= spread
        if not free.any():
            return False
        reachable = free
    return True


def sectors(known: Mask, drivable: Mask, region: Region, count: int = 16) -> tuple[float | None, ...]:
    """Drivable share of the known pixels in `count` equal image columns, over the ROI's rows; None: unknown."""
    height, width = known.shape
    rows, _ = region.bounds.slices(height, width)
    edges = [round(index * width / count) for index in range(count + 1)]
    shares: list[float | None] = []
    for left, right in pairwise(edges):
        seen = int(known[rows, left:right].sum())
        shares.append(float(drivable[rows, left:right].sum()) / seen if seen else None)
    return tuple(shares)
