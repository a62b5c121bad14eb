"""Learning the look of a tapped thing from one box of one frame.

The box may be larger than the thing, or hold only half of it: the thing is what differs most from the rest
of the frame, and what continues it beyond the box. After exemplar LDA, in simple form.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.perception.ground_features import LOOK, Grid
from anytraverse.perception.looks import Look
from anytraverse.regions import Box

Mask = NDArray[np.bool_]

_SCALE = np.array([0.08, 0.08, 0.3, 1.0], dtype=np.float32)
"""Differences in redness, yellowness, light and roughness that count alike. Roughness says little here:
it is high at every edge."""
_LEAST = np.array([0.05, 0.06, 0.3, 0.5], dtype=np.float32)
"""Spreads that a look keeps at least: another distance, another light."""
_MOST = np.array([0.1, 0.12, 0.5, 0.8], dtype=np.float32)
_VIVID = np.array([0.12, 0.12, 0.0, 0.0], dtype=np.float32)
"""How much the spreads of vivid colours widen: they fade as a channel saturates."""
_NEARER = np.array([1.1, 1.1, 1.0, 1.0], dtype=np.float32)
"""Nearer, a thing's colours are purer: from afar its cells are mixed with what is around it."""
_LEAST_CELLS = 6
_REACH = 3.0  # how far the thing may continue beyond the box, in sizes of the box
_ENOUGH = 0.15  # share of the image that makes a background
_SAMPLES = 900  # cells of the background that are compared with
_COMMON = 0.04  # share of the background that must look alike to count as background
_NOVEL = 1.5  # scaled difference from which something is there that the background lacks
_CORE = 0.75  # of the highest difference in the box: surely the thing
_SAME = 2.0  # scaled difference from the core up to which neighbouring cells belong to it


def learn_look(grid: Grid, box: Box) -> Look:
    """The look of what the box shows. Raises ExampleError when the box is too small."""
    inside = box.mask(*grid.shape[:2])
    if inside.sum() < _LEAST_CELLS:
        raise ExampleError("the box is too small to learn from: draw a larger one around the thing")
    thing, pure = _find_thing(grid[..., LOOK] / _SCALE, inside, box)
    centre = np.median(grid[pure][:, LOOK], axis=0) * _NEARER
    spread = np.clip(grid[thing][:, LOOK].std(axis=0), _LEAST, _MOST) + _VIVID * np.abs(centre)
    return look_of(np.concatenate([centre, spread]))


def look_of(vector: NDArray[np.float32]) -> Look:
    """The look that a vector of four centres and four spreads stands for."""
    pairs = [(float(centre), float(spread)) for centre, spread in vector.reshape(2, 4).T]
    return Look(pairs[0], pairs[1], pairs[2], pairs[3])


def vector_of(look: Look) -> NDArray[np.float32]:
    """Four centres and four spreads, (8,)."""
    return np.array(look[LOOK], dtype=np.float32).T.reshape(-1)


def _find_thing(cells: NDArray[np.float32], inside: Mask, box: Box) -> tuple[Mask, Mask]:
    """The thing's cells, and the purer half of them.

    They are the box's most unusual cells and their like around them, or else the whole box.
    """
    reach = box.grown(_REACH).mask(*inside.shape)
    background = cells[_background(inside, reach)]
    if len(background) < _LEAST_CELLS:
        return inside, inside
    novelty = np.zeros(inside.shape, dtype=np.float32)
    novelty[reach] = _distance_to(background, cells[reach])
    highest = float(np.quantile(novelty[inside], 0.95))
    if highest < _NOVEL:
        return inside, inside
    core = inside & (novelty >= _CORE * highest)
    alike = np.linalg.norm(cells - np.median(cells[core], axis=0), axis=2) < _SAME
    alike &= reach & (novelty >= 0.75 * highest)
    parts = cv2.connectedComponents((alike | core).astype(np.uint8))[1]
    thing: Mask = np.isin(parts, np.unique(parts[core]))
    return thing, thing & (novelty >= np.median(novelty[thing]))


def _background(inside: Mask, reach: Mask) -> Mask:
    """What the thing stands out from: its own height in the image and below, where there is enough of it.

    Above it is the sky, which grey things resemble.
    """
    level = np.zeros_like(inside)
    level[np.flatnonzero(inside.any(axis=1))[0] :] = True
    for candidate in (level & ~reach, level & ~inside):
        if candidate.mean() >= _ENOUGH:
            return candidate
    return ~inside


def _distance_to(background: NDArray[np.float32], cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """How far each cell is from what is common in the background, (cells,)."""
    sample = background[:: max(1, len(background) // _SAMPLES)]
    gaps = (cells**2).sum(axis=1)[:, None] + (sample**2).sum(axis=1) - 2 * cells @ sample.T
    rank = int(_COMMON * len(sample))
    nearest = np.partition(gaps, rank, axis=1)[:, rank]
    return np.sqrt(np.maximum(nearest, 0.0)).astype(np.float32)
