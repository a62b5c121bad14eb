"""Masks of a thing that is followed from frame to frame, made coarse so that the work is bounded."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

_CELLS = 96
"""A thing is kept and followed in maps of at most so many cells a side: larger ones are made coarser."""


def coarse(mask: Mask) -> Mask:
    """The mask in at most `_CELLS` cells a side: one counts where any of its pixels does."""
    for axis in (0, 1):
        size = mask.shape[axis]
        if size > _CELLS:
            mask = np.logical_or.reduceat(mask, -(-np.arange(_CELLS) * size // _CELLS), axis=axis)
    return mask


def resized(mask: Mask, height: int, width: int) -> Mask:
    """The mask in another size, (height, width): as `coarse` makes it smaller, where it is larger."""
    rows = np.arange(height) * mask.shape[0] // height
    larger: Mask = mask[rows][:, np.arange(width) * mask.shape[1] // width]
    return larger


def joined(one: Mask | None, other: Mask | None) -> Mask | None:
    """Both together, in the size of the first."""
    if one is None or other is None:
        return other if one is None else one
    return one | resized(other, *one.shape)


def wider(mask: Mask) -> Mask:
    """The mask and a cell around it."""
    return connected(mask, np.ones_like(mask), 1)


def below(mask: Mask, aside: int) -> Mask:
    """What is not above the mask in its columns and in so many beside each."""
    down = np.pad(np.logical_or.accumulate(mask, axis=0), ((0, 0), (aside, aside)))
    beside: Mask = np.any(sliding_window_view(down, 2 * aside + 1, axis=1), axis=-1)
    return beside


def connected(seed: Mask, within: Mask, steps: int) -> Mask:
    """`seed` and the pixels of `within` that lead to it over at most `steps` of their sides."""
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
