"""Calculates figures of the region of interest: the worst tile, the corridor, the sectors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.regions import Box, Region, TileScale

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]

KNOWN = 0.5
"""A word explains a pixel when its attention there is at least this."""

_GAP = 0.9
"""A square is a gap in the corridor when at least this share of its cells is not drivable."""
_ROUNDING = 1e-9
_FITS = 1e-6
"""By so little a region may be narrower than the corridor: its sides are told as floats of 32 bits."""


@dataclass(frozen=True)
class Corridor:
    """Holds the vehicle's width as fractions of the image's width, whatever the ROI.

    bottom, top: the width at `bottom_row` and at `top_row`, themselves fractions of its height, [0, 1].
    It is linear between and beyond them, as on flat ground.
    share: of its cells that must be drivable in each of `bands` bands from near to far, (0, 1].
    gap: side of the smallest gap that closes the corridor, over the ROI's width, (0, 1]. A tile may be
    smaller: single cells along ragged borders are not drivable, and would be a gap.
    room: a strip is wider than the vehicle by this factor where the ROI leaves room for it, 1 or more.
    rows: only between these rows must a strip lead through the ROI, None: through all of it. The ends of a
    ROI that is no box may be narrower than the vehicle.
    Raises SettingsError for fractions that are not above 0, for rows that are not in this order, and for
    share, bands, gap or room out of range.
    """

    bottom: float
    top: float
    share: float = 0.8
    bands: int = 5
    gap: float = 0.25
    bottom_row: float = 0.95
    top_row: float = 0.6
    room: float = 1.0
    rows: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (0.0 < self.bottom < math.inf and 0.0 < self.top < math.inf):
            raise SettingsError(f"{self} has no width: give fractions of the image's width above 0")
        if not (0.0 < self.share <= 1.0 and self.bands >= 1):
            raise SettingsError(
                f"{self} asks for nothing: give a share above 0, at most 1, and a band or more"
            )
        if not 0.0 < self.gap <= 1.0:
            raise SettingsError(f"{self} has no gap: give a share of the ROI's width above 0, at most 1")
        if not 0.0 <= self.top_row < self.bottom_row <= 1.0:
            raise SettingsError(f"{self} holds at no two rows: give a top_row above bottom_row, 0 to 1")
        if not 1.0 <= self.room < math.inf:
            raise SettingsError(f"{self} is narrower than the vehicle: give a room of 1 or more")

    def roomier(self, factor: float, margin: float) -> Corridor:
        """Return this corridor with strips `factor` times as wide, and its share raised by `margin`."""
        return replace(self, room=factor, share=min(1.0, self.share + margin))

    @property
    def horizon(self) -> float:
        """The row at which its width is 0, as a fraction of the image's height; it may lie outside [0, 1]."""
        return self.bottom_row - self.bottom / self._slope if self._slope else -math.inf

    @property
    def _slope(self) -> float:
        return (self.bottom - self.top) / (self.bottom_row - self.top_row)

    def misfit(self, bounds: Box) -> str:
        """Return why the vehicle does not fit into these bounds of a region, "" where it does.

        The text says what to do, and is short enough for a STATUSTEXT.
        """
        widths = [self.bottom + self._slope * (row - self.bottom_row) for row in (bounds.top, bounds.bottom)]
        if min(widths) <= 0.0:
            return f"ROI reaches the horizon {self.horizon:.2f}: shorten it"
        has, needs = bounds.right - bounds.left, max(widths)
        if needs <= has + _FITS:
            return ""
        has, needs = math.floor(100 * has + 1e-4) / 100, math.ceil(100 * needs - 1e-4) / 100
        return f"ROI {has:.2f} wide, vehicle {needs:.2f}: widen it"


@dataclass(frozen=True)
class Tile:
    """Holds a square window of the ROI and its mean uncertainty, in [0, 1].

    around: a larger square around a window that is smaller than the things that are looked for, or the whole
    upright square of which only the lower part lies in the ROI.
    """

    box: Box
    uncertainty: float
    around: Box | None = None

    @property
    def shown(self) -> Box:
        """The box that is shown and tapped: the square around the window where there is one."""
        return self.around or self.box


@dataclass(frozen=True)
class NamedTile:
    """Holds the worst tile of the strangeness map, which leaves out the words of no positive weight.

    Strangeness is the uncertainty as it would be without these words: see `Maps.strangeness`. Where the worst
    tile of the uncertainty map is over its threshold, this is a tile outside of that one.
    tile: its box, and its mean strangeness in place of the uncertainty. left: its mean uncertainty with all
    words, in [0, 1]. word: index of the word of no positive weight that explains most of it.
    """

    tile: Tile
    left: float
    word: int

    @property
    def explained(self) -> float:
        """The share of its strangeness that words of no positive weight explain, in [0, 1]."""
        return explained(self.tile.uncertainty, self.left)


@dataclass(frozen=True)
class Passage:
    """Holds whether a corridor of the vehicle's width leads through the ROI.

    open: over drivable ground. passable: it would be open if all that is uncertain were drivable. roomy,
    passable_roomy: the same for a wider corridor, with a margin on its share.
    gap: the square as large as a gap in which most pixels close the corridor; None where it is open.
    explained: the share of the strangeness around it that words of no positive weight explain, in [0, 1].
    """

    open: bool
    passable: bool
    roomy: bool
    passable_roomy: bool
    gap: Tile | None = None
    explained: float = 0.0


@dataclass(frozen=True)
class RoiFigures:
    """Holds the figures of one frame's ROI.

    uncertainty, strangeness, traversability: means over the ROI, in [0, 1].
    known_share: share of the pixels that some word explains. drivable_share: the drivable share of these;
    None where no pixel is explained. named_tile: None where every word has a positive weight.
    """

    uncertainty: float
    strangeness: float
    traversability: float
    known_share: float
    drivable_share: float | None
    corridor: Passage
    worst_tile: Tile
    named_tile: NamedTile | None = None


def explained(strange: float, left: float) -> float:
    """Return the share of the uncertainty `strange` that is explained when `left` remains, in [0, 1]."""
    return 1.0 - left / strange if strange > 0.0 else 0.0


def worst_tile(
    uncertainty: Map,
    region: Region,
    aspect: float,
    share: float | TileScale = 0.25,
    outside: Mask | None = None,
) -> Tile | None:
    """Return the square window of the ROI whose mean uncertainty is highest.

    uncertainty: (h, w). aspect: width / height of the frame. share: the window's side over the ROI's width,
    or by the row of its foot, which lies in the ROI; its upper part need not.
    outside: a (h, w) mask whose pixels do not count; a window counts when at least half of its pixels do.
    None when no window counts. A NaN in the ROI gives a tile of uncertainty NaN.
    """
    height, width = uncertainty.shape
    bounds = region.bounds
    rows, columns = bounds.slices(height, width)
    counted = region.mask(height, width)
    if outside is not None:
        counted = counted & ~outside
    counted = counted[rows, columns]
    values = np.where(counted, uncertainty[rows, columns], 0.0)
    if not counted.any():
        return None
    if isinstance(share, TileScale):
        return _worst_upright(values, counted, (rows.start, columns.start), uncertainty.shape, aspect, share)
    tile_height, tile_width = tile_size(height, width, bounds, aspect, share)
    sums = _window_sums(values, tile_height, tile_width)
    counts = _window_sums(counted.astype(np.float64), tile_height, tile_width)
    enough = counts >= 0.5 * tile_height * tile_width
    if not enough.any():
        return None
    means = np.where(enough, sums / np.maximum(counts, 1.0), -1.0)  # -1: never the highest
    row, column = np.unravel_index(int(np.argmax(means)), means.shape)
    top, left = rows.start + int(row), columns.start + int(column)
    box = Box(left / width, top / height, (left + tile_width) / width, (top + tile_height) / height)
    return Tile(box, float(np.clip(means[row, column], 0.0, 1.0)))


def _worst_upright(
    values: Map,
    counted: Mask,
    start: tuple[int, int],
    shape: tuple[int, ...],
    aspect: float,
    tiles: TileScale,
) -> Tile | None:
    """Do what `worst_tile` does for windows whose size depends on the row of their foot.

    values, counted: (rows, columns) of the ROI's bounds, which begin at the row and column `start` of a map
    of `shape`.
    """
    height, width = shape
    rows, columns = values.shape
    feet = np.arange(rows)
    sides = [tiles.side((start[0] + row + 1) / height) for row in feet]
    wide = np.clip(np.rint(np.multiply(sides, width)), 1, columns).astype(np.intp)
    high = np.maximum(1, np.rint(np.multiply(sides, aspect * height))).astype(np.intp)
    tops, ends = np.maximum(0, feet + 1 - high)[:, np.newaxis], (feet + 1)[:, np.newaxis]
    lefts = np.arange(columns)[np.newaxis, :]
    rights = np.minimum(columns, lefts + wide[:, np.newaxis])

    def window(of: Map | Mask) -> NDArray[np.float64]:
        table = _summed_area(of)
        return np.asarray(table[ends, rights] - table[tops, rights] - table[ends, lefts] + table[tops, lefts])

    counts = window(counted)
    area = (ends - tops) * wide[:, np.newaxis]
    enough = (counts >= 0.5 * area) & (rights - lefts == wide[:, np.newaxis])
    if not enough.any():
        return None
    means = np.where(enough, window(values) / np.maximum(counts, 1.0), -1.0)
    # Of equal ones the nearest: a thing's upper part holds smaller windows, and its foot is where it stands.
    above, left = (int(at) for at in np.unravel_index(int(np.argmax(means[::-1])), means.shape))
    foot = rows - 1 - above
    top, first = start[0] + int(tops[foot, 0]), start[1] + left
    box = Box(first / width, top / height, (first + int(wide[foot])) / width, (start[0] + foot + 1) / height)
    # At the ROI's far side only the foot of a thing lies in it: too little to be shown, or learnt from a tap.
    upright = max(0, start[0] + foot + 1 - int(high[foot])) / height
    around = replace(box, top=upright) if upright < box.top else None
    return Tile(box, float(np.clip(means[foot, left], 0.0, 1.0)), around)


def tile_size(height: int, width: int, bounds: Box, aspect: float, share: float) -> tuple[int, int]:
    """Return the rows and columns of a tile in a map of (height, width).

    A tile has at least one pixel, and is no larger than the ROI, which must hold a pixel.
    """
    rows, columns = bounds.slices(height, width)
    side = share * (bounds.right - bounds.left)
    return (
        min(max(1, round(side * aspect * height)), rows.stop - rows.start),
        min(max(1, round(side * width)), columns.stop - columns.start),
    )


def _summed_area(values: NDArray[np.floating] | Mask) -> NDArray[np.float64]:
    """Return the summed-area table of (h, w) values, (h + 1, w + 1)."""
    table = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    table[1:, 1:] = values.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    return table


def _window_sums(values: NDArray[np.floating], height: int, width: int) -> NDArray[np.float64]:
    """Sum every window of (height, width), by a summed-area table."""
    table = _summed_area(values)
    sums: NDArray[np.float64] = (
        table[height:, width:] - table[:-height, width:] - table[height:, :-width] + table[:-height, :-width]
    )
    return sums


def corridor_open(drivable: Mask, region: Region, corridor: Corridor, gap: tuple[int, int]) -> bool:
    """Return whether a strip of the vehicle's width leads over drivable ground from the ROI's bottom to top.

    drivable: (h, w). gap: rows and columns of a gap. The strip may shift by one pixel of the map a row. In
    each of its bands at least `corridor.share` of its cells must be drivable, and no gap may be in it. It
    stays inside the ROI. False when the ROI holds no pixel, or the vehicle does not fit in.
    """
    height, width = drivable.shape
    rows, columns = region.bounds.slices(height, width)
    if corridor.rows is not None:
        top, bottom = (math.ceil(row * height - 0.5) for row in corridor.rows)
        rows = slice(max(rows.start, top), max(rows.start, top, min(rows.stop, bottom)))
    gap = min(gap[0], max(1, rows.stop - rows.start)), gap[1]
    outside = ~region.mask(height, width)[rows, columns]
    missing = ~drivable[rows, columns] | outside
    if missing.size == 0 or missing.all() or corridor.misfit(region.bounds):
        return False
    if not missing.any():
        return True
    strips = _strips(rows.start, *missing.shape, height, width, corridor, gap[1])
    gaps = _count_between(_gaps(missing, gap), strips.begin, strips.gaps_end)
    if outside.any():
        gaps += _count_between(outside, strips.begin, strips.end)
    lost = np.where(strips.inside & (gaps == 0), _count_between(missing, strips.begin, strips.end), np.inf)
    # Dynamic programming: for each column where the strip may stand, the fewest cells that are not drivable
    # in the part of a band that it has crossed so far.
    edged = np.full(missing.shape[1] + 2, np.inf)
    before, least, after = edged[:-2], edged[1:-1], edged[2:]
    reachable = np.ones(missing.shape[1], dtype=np.bool_)
    for band, allowed in strips.bands:
        least[:] = np.where(reachable, 0.0, np.inf)
        for lost_here in lost[band]:
            nearby = np.minimum(before, after)
            np.minimum(nearby, least, out=nearby)
            np.add(nearby, lost_here, out=least)
        reachable = least <= allowed
    return bool(reachable.any())


@dataclass(frozen=True)
class _Strips:
    """Holds where a strip of the vehicle's width may stand in an ROI of (h, w) pixels: all (h, w).

    begin, end: its first column, and the one after its last, when its middle is in this column, in [0, w].
    gaps_end: the column after the last in which a gap inside it begins, in [0, w]. inside: whether it fits.
    bands: from near to far, the rows, and how many cells that are not drivable are allowed in them.
    """

    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    gaps_end: NDArray[np.intp]
    inside: Mask
    bands: tuple[tuple[NDArray[np.intp], float], ...]


@lru_cache(16)
def _strips(
    start: int, count: int, across: int, height: int, width: int, corridor: Corridor, gap: int
) -> _Strips:
    """Place the strips in an ROI of (count, across) pixels, which the vehicle fits in but for rounding.

    start: the ROI's first row. height, width: the map's. gap: columns of a gap.
    """
    # Measured from the map's last row at or above `bottom_row`: no strip is narrower than the vehicle there.
    last = math.ceil(corridor.bottom_row * height - 0.5) - 1
    rise = (last - np.arange(start, start + count)) / (height * (corridor.bottom_row - corridor.top_row))
    bottom, top = corridor.bottom * corridor.room, corridor.top * corridor.room
    wanted = (bottom + (top - bottom) * rise) * width
    strip = np.clip(np.rint(wanted), 1, across).astype(np.intp)[:, np.newaxis]
    left = np.arange(across) - strip // 2
    bands = np.array_split(np.arange(count)[::-1], min(corridor.bands, count))
    begin, end = np.clip(left, 0, across), np.clip(left + strip, 0, across)
    return _Strips(
        begin,
        end,
        np.maximum(begin, np.clip(left + strip - gap + 1, 0, across)),
        (left >= 0) & (left + strip <= across),
        tuple((band, float((1.0 - corridor.share) * strip[band].sum() + _ROUNDING)) for band in bands),
    )


def _gaps(missing: Mask, size: tuple[int, int]) -> Mask:
    """Mark (row, column) where a gap that begins in this column covers this row, (h, w)."""
    gaps = np.zeros(missing.shape, dtype=np.bool_)
    found = _window_sums(missing.astype(np.float64), *size) >= _GAP * size[0] * size[1]
    for down in range(size[0]):
        gaps[down : down + found.shape[0], : found.shape[1]] |= found
    return gaps


def _count_between(mask: Mask, begin: NDArray[np.intp], end: NDArray[np.intp]) -> NDArray[np.float64]:
    """Count the pixels of each row of `mask` from column `begin` up to, not including, `end`, (h, n).

    mask: (h, w). begin, end: (h, n), in [0, w], begin <= end.
    """
    table = np.zeros((len(mask), mask.shape[1] + 1))
    table[:, 1:] = mask.cumsum(axis=1)
    counts: NDArray[np.float64] = np.take_along_axis(table, end, axis=1)
    counts -= np.take_along_axis(table, begin, axis=1)
    return counts


def sectors(known: Mask, drivable: Mask, region: Region, count: int = 16) -> tuple[float | None, ...]:
    """Return the drivable share of the known pixels in `count` equal image columns, over the ROI's rows.

    known, drivable: (h, w). None for a column without a known pixel.
    """
    height, width = known.shape
    rows, _ = region.bounds.slices(height, width)
    edges = [round(index * width / count) for index in range(count + 1)]
    shares: list[float | None] = []
    for left, right in pairwise(edges):
        seen = int(known[rows, left:right].sum())
        shares.append(float(drivable[rows, left:right].sum()) / seen if seen else None)
    return tuple(shares)
