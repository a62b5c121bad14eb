"""Computes with masks of a thing that is tracked from frame to frame.

Masks are made coarse first, so that the work is bounded whatever the size of a perceiver's maps.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

_CELLS = 96
"""Most cells a side of the mask of a tracked thing. Larger masks are made coarser."""


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
    down = np.pad(np.logical_or.accumulate(mask, axis=0), ((0, 0), (aside, aside)))
    beside: Mask = np.any(sliding_window_view(down, 2 * aside + 1, axis=1), axis=-1)
    return beside


def connected(seed: Mask, within: Mask, steps: int) -> Mask:
    """Grow `seed` inside `within` by `steps` cells at most; cells are neighbours where they share a side.

    The result lies in `within` where `steps` is at least 1.
    """
    for _ in range(steps):
        spread = seed.copy()
        spread[1:] |= seed[:-1]
        spread[:-1] |= seed[1:]
        spread[:, 1:] |= seed[:, :-1]
        spread[:, :-1] |= seed[:, 1:]
        spread &= within
        if np.array_equal(spread, seed):
            break
        seed = spread
    return seed
