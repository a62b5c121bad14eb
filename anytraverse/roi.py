"""What stands in the region of interest, in figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.regions import Box, Region

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]

KNOWN = 0.5
"""A pixel is explained by a word when its attention reaches this."""

_STRAY = 0.1
"""Share of a corridor's width that may be not drivable: stray pixels, not things."""


@dataclass(frozen=True)
class Corridor:
    """The vehicle's width as fractions of the image's width, at the bottom and the top of the ROI.

    Raises SettingsError for fractions that are not above 0.
    """

    bottom: float
    top: float

    def __post_init__(self) -> None:
        if not (0.0 < self.bottom < math.inf and 0.0 < self.top < math.inf):
            raise SettingsError(f"{self} has no width: give fractions of the image's width above 0")

    def wider(self, factor: float) -> Corridor:
        """This corridor for a vehicle `factor` times as wide."""
        return Corridor(self.bottom * factor, self.top * factor)


@dataclass(frozen=True)
class Tile:
    """A square window of the ROI and its mean uncertainty, in [0, 1]."""

    box: Box
    uncertainty: float


@dataclass(frozen=True)
class NamedTile:
    """The tile that would be the worst if nothing had been tapped as not drivable, as it would be then.

    Where the worst tile calls already, it is one beside that.
    left: its mean uncertainty with all words, in [0, 1]. word: index of the tapped one that explains most.
    """

    tile: Tile
    left: float
    word: int

    @property
    def explained(self) -> float:
        """Share of what is strange in it that the tapped words account for, in [0, 1]."""
        strange = self.tile.uncertainty
        return 1.0 - self.left / strange if strange > 0.0 else 0.0


@dataclass(frozen=True)
class RoiFigures:
    """Figures of one frame's ROI.

    uncertainty, traversability: means over the ROI, in [0, 1].
    known_share: pixels that some word explains. drivable_share: the drivable ones of these, or None.
    corridor: whether the vehicle fits through; None when not judged. named_tile: None when nothing was tapped
    as not drivable.
    """

    uncertainty: float
    traversability: float
    known_share: float
    drivable_share: float | None
    corridor: bool | None
    worst_tile: Tile
    named_tile: NamedTile | None = None


def worst_tile(
    uncertainty: Map, region: Region, aspect: float, share: float = 0.25, outside: Box | None = None
) -> Tile | None:
    """The square window of the ROI whose mean uncertainty is highest.

    uncertainty: (h, w). aspect: width / height of the frame. share: the window's side over the ROI's width.
    outside: only pixels outside this box count, and windows of which they fill at least half.
    None when no window is left. NaN in, NaN out.
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
    table[1:, 1:] = values.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    sums: NDArray[np.float64] = (
        table[height:, width:] - table[:-height, width:] - table[height:, :-width] + table[:-height, :-width]
    )
    return sums


def corridor_open(not_drivable: Mask, region: Region, corridor: Corridor) -> bool:
    """Whether a strip of the vehicle's width leads through the ROI from bottom to top.

    not_drivable: (h, w). The strip may shift by one pixel of the map a row, and bear stray pixels.
    False when the ROI holds no pixel.
    """
    height, width = not_drivable.shape
    rows, columns = region.bounds.slices(height, width)
    blocked = not_drivable[rows, columns]
    if blocked.size == 0:
        return False
    count, across = blocked.shape
    rise = np.arange(count - 1, -1, -1) / max(1, count - 1)
    wanted = (corridor.bottom + (corridor.top - corridor.bottom) * rise) * width
    strip = np.clip(np.rint(wanted), 1, across).astype(np.intp)[:, np.newaxis]
    free = _window_counts(blocked, strip) <= _STRAY * strip
    reachable = free[-1]
    for row in free[-2::-1]:
        spread = reachable.copy()
        spread[1:] |= reachable[:-1]
        spread[:-1] |= reachable[1:]
        reachable = row & spread
    return bool(reachable.any())


def _window_counts(mask: Mask, widths: NDArray[np.intp]) -> NDArray[np.float64]:
    """Pixels of `mask` under a window about each pixel of each row; infinity where it leaves the row.

    mask: (h, w). widths: (h, 1), the window's width in each row, 1 to w.
    """
    across = mask.shape[1]
    table = np.zeros((len(mask), across + 1))
    table[:, 1:] = mask.cumsum(axis=1)
    left = np.arange(across) - widths // 2
    right = left + widths
    inside = (left >= 0) & (right <= across)
    upto_right = np.take_along_axis(table, np.minimum(right, across), axis=1)
    upto_left = np.take_along_axis(table, np.maximum(left, 0), axis=1)
    return np.where(inside, upto_right - upto_left, np.inf)


def sectors(known: Mask, drivable: Mask, region: Region, count: int = 16) -> tuple[float | None, ...]:
    """Drivable share of the known pixels in `count` equal image columns, over the ROI's rows.

    known, drivable: (h, w). None for a column in which nothing is known.
    """
    height, width = known.shape
    rows, _ = region.bounds.slices(height, width)
    edges = [round(index * width / count) for index in range(count + 1)]
    shares: list[float | None] = []
    for left, right in pairwise(edges):
        seen = int(known[rows, left:right].sum())
        shares.append(float(drivable[rows, left:right].sum()) / seen if seen else None)
    return tuple(shares)
