"""Tracks an accepted thing from frame to frame, as a coarse mask; what is done with such masks. Pure.

Masks are made coarse first, so that the work is bounded whatever the size of a perceiver's maps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import CORRIDOR, NAMED_MEAN, NAMED_TILE, Assessment, Maps, Reason
from anytraverse.roi import KNOWN
from companion.calls.numbers import Numbers

Mask = NDArray[np.bool_]

_CELLS = 96
"""Most cells a side of the mask of a tracked thing. Larger masks are made coarser."""
_UNCERTAIN_PIXEL = 0.5
"""Uncertainty above which a pixel belongs to the thing, where tiles have no threshold."""
_REACH = 0.25
"""Over the ROI's width: a thing becomes wider by less than this from frame to frame."""
NAMED_FIGURES = frozenset({NAMED_TILE, NAMED_MEAN})
"""The figures of things that only a negative word explains."""


def coarse(mask: Mask) -> Mask:
    """Reduce an (h, w) mask to at most `_CELLS` cells a side. A cell is set where any of its pixels is."""
    for axis in (0, 1):
        size = mask.shape[axis]
        if size > _CELLS:
            mask = np.logical_or.reduceat(mask, -(-np.arange(_CELLS) * size // _CELLS), axis=axis)
    return mask


def resized(mask: Mask, height: int, width: int) -> Mask:
    """Resize a mask to (height, width). Enlarging a `coarse` mask gives each pixel its cell's value."""
    rows = np.arange(height) * mask.shape[0] // height
    larger: Mask = mask[rows][:, np.arange(width) * mask.shape[1] // width]
    return larger


def joined(one: Mask | None, other: Mask | None) -> Mask | None:
    """Return the union of two masks, in the size of the first. None is an empty mask."""
    if one is None or other is None:
        return other if one is None else one
    return one | resized(other, *one.shape)


def wider(mask: Mask) -> Mask:
    """Return the mask, grown by one cell up, down, left and right."""
    return connected(mask, np.ones_like(mask), 1)


def below(mask: Mask, aside: int) -> Mask:
    """Return the mask's cells and all below them, in its columns and in `aside` columns to either side."""
    down: Mask = np.logical_or.accumulate(mask, axis=0)
    if aside == 0:
        return down
    height, width = mask.shape
    counts = np.zeros((height, width + 1), dtype=np.intp)
    down.cumsum(axis=1, out=counts[:, 1:])
    columns = np.arange(width)
    beside: Mask = (
        counts[:, np.minimum(columns + aside + 1, width)] > counts[:, np.maximum(columns - aside, 0)]
    )
    return beside


def connected(seed: Mask, within: Mask, steps: int) -> Mask:
    """Grow `seed` inside `within` by `steps` cells at most; cells are neighbours where they share a side.

    The result lies in `within` where `steps` is at least 1.
    """
    row = seed.shape[1] + 1
    cells, allowed = _bits(seed), _bits(within)
    for _ in range(steps):
        spread = (cells | cells << 1 | cells >> 1 | cells << row | cells >> row) & allowed
        if spread == cells:
            break
        cells = spread
    return _mask(cells, *seed.shape)


def _bits(mask: Mask) -> int:
    """Return an (h, w) mask as an integer, a bit a cell, with an empty bit after each row.

    So all cells are shifted at once, some 20 times as fast as in an array, and no row touches the next.
    """
    spaced = np.zeros((mask.shape[0], mask.shape[1] + 1), dtype=np.bool_)
    spaced[:, :-1] = mask
    return int.from_bytes(np.packbits(spaced, bitorder="little").tobytes(), "little")


def _mask(bits: int, height: int, width: int) -> Mask:
    count = height * (width + 1)
    packed = np.frombuffer(bits.to_bytes((count + 7) // 8, "little"), np.uint8)
    spaced = np.unpackbits(packed, count=count, bitorder="little").reshape(height, width + 1)
    return spaced[:, :-1].astype(np.bool_)


def named_reasons(seen: Assessment) -> frozenset[Reason]:
    """Return the frame's bad reasons that come from things which only a negative word explains."""
    return frozenset(one.reason for one in seen.bad if one.figure in NAMED_FIGURES)


def blocked_by_name(seen: Assessment) -> bool:
    """Whether the frame is blocked only by things that a negative word explains."""
    figures = {one.figure for one in seen.bad if one.reason is Reason.BLOCKED}
    passable = seen.roi is not None and seen.roi.corridor.passable
    return bool(figures) and figures <= NAMED_FIGURES | ({CORRIDOR} if passable else set())


def track(
    thing: Mask, seen: Assessment, maps: Maps, numbers: Numbers, *, blocks: bool, at_once: bool = False
) -> Mask:
    """Return the uncertain pixels in `thing` or at its foot, and those connected to them, grown by one cell.

    blocks: the thing blocks the way, so that ground in the ROI that is not drivable belongs to it, too.
    at_once: take all connected uncertain pixels, as when the thing is accepted. Otherwise the mask grows
    straight down, and by less than `_REACH` to the sides, since a thing comes no nearer than that from
    frame to frame. An uncertain area that reaches further belongs to another thing that touches this one.
    Of that area the mask takes only the pixels straight below it.

    Above the horizon, only what is straight above the thing belongs to it: what rises above it touches all
    that is unknown there.

    Pixels that a negative word explains belong to the thing, too. Left out, they would count as a second
    thing beside it. But the word may explain the ground around as well, so at most `_REACH` of such
    pixels is taken at the start, and later only those straight below.
    """
    limit = uncertain_above(numbers)
    if any(one.figure == CORRIDOR for one in seen.bad):
        # Above this uncertainty a pixel is missing in the corridor, whatever the tiles' threshold.
        limit = min(limit, 1.0 - KNOWN)
    uncertain, strange = maps.uncertainty > limit, maps.strangeness > limit
    if blocks:
        uncertain = uncertain | (~maps.drivable & numbers.judging.region.mask(*uncertain.shape))
    uncertain, strange = coarse(uncertain), coarse(strange)
    thing = resized(thing, *uncertain.shape)
    in_rows = np.arange(len(thing))[:, np.newaxis] >= round(_highest(numbers) * len(thing))
    reach = _reach(uncertain.shape[1], numbers)
    if at_once:
        found = connected(thing & uncertain, uncertain & in_rows, max(uncertain.shape))
        above = in_rows | found.any(axis=0)
        found = connected(found, uncertain & above, max(uncertain.shape))
        return wider(connected(found, strange & above, reach))
    not_above, straight = below(thing, reach), below(thing, 0)
    uncertain = uncertain & not_above & (in_rows | (thing & in_rows).any(axis=0))
    # A perceiver may see the foot of a thing apart from the rest, by a gap of one cell. Right before the
    # vehicle the foot comes down by more than the reach.
    down = connected(wider(thing) & straight & uncertain, uncertain & straight, max(uncertain.shape))
    found = connected(down, uncertain, reach - 1)
    beyond = connected(found, uncertain, 1) & ~found
    found = found & (straight | ~connected(beyond, uncertain & ~thing, max(uncertain.shape)))
    if named_reasons(seen):
        found = found | connected(thing & strange, strange & straight, reach - 1)
    return wider(found) & not_above if found.any() else thing


def uncertain_above(numbers: Numbers) -> float:
    """Return the uncertainty above which a pixel belongs to a thing."""
    return numbers.judging.thresholds.tile or _UNCERTAIN_PIXEL


def sized(thing: Mask | None, seen: Assessment) -> Mask:
    """Return the thing's mask in the size of the frame's maps, (h, w)."""
    if seen.maps is None:
        return np.zeros((1, 1), dtype=np.bool_)
    shape = seen.maps.signed.shape
    return np.zeros(shape, dtype=np.bool_) if thing is None else resized(thing, *shape)


def _highest(numbers: Numbers) -> float:
    """Return the horizon's row, in fractions of the height; the ROI's upper side where it is unknown."""
    top, horizon = numbers.judging.region.bounds.top, numbers.judging.corridor.horizon
    return horizon if 0.0 < horizon < top else top


def _reach(width: int, numbers: Numbers) -> int:
    """Return `_REACH` in pixels, for a map that is `width` pixels wide."""
    bounds = numbers.judging.region.bounds
    return max(1, round(_REACH * (bounds.right - bounds.left) * width))
