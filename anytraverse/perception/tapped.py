"""Learning the look of a tapped thing from one box of one frame.

The box may be larger than the thing, or hold only half of it: the thing is what differs most from the rest
of the frame. After exemplar LDA, in simple form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.perception.ground_features import LOOK, Grid
from anytraverse.perception.looks import Look
from anytraverse.regions import Box

Cells = NDArray[np.float32]

_SCALE = np.array([0.08, 0.08, 0.3, 0.4], dtype=np.float32)
"""Differences in redness, yellowness, light and roughness that count alike."""
_LEAST = np.array([0.05, 0.05, 0.35, 0.5], dtype=np.float32)
"""Spreads that a look keeps at least: another distance, another light."""
_MOST = np.array([0.12, 0.12, 0.6, 0.9], dtype=np.float32)
_LEAST_CELLS = 6
_SAMPLES = 900  # cells of the background that are compared with
_COMMON = 0.06  # share of the background that must look alike to count as background
_NOVEL = 1.5  # differences from which a cell is surely something else


def learn_look(grid: Grid, box: Box) -> Look:
    """The look of what the box shows. Raises ExampleError when the box is too small."""
    inside = box.mask(*grid.shape[:2])
    if inside.sum() < _LEAST_CELLS:
        raise ExampleError("the box is too small to learn from: draw it around the thing, larger")
    cells, rest = grid[inside][:, LOOK], grid[~inside][:, LOOK]
    thing = cells[_novel(cells, rest)]
    centre = np.median(thing, axis=0)
    spread = np.clip(thing.std(axis=0), _LEAST, _MOST)
    return look_of(np.concatenate([centre, spread]))


def look_of(vector: NDArray[np.float32]) -> Look:
    """The look that a vector of four centres and four spreads stands for."""
    pairs = [(float(centre), float(spread)) for centre, spread in vector.reshape(2, 4).T]
    return Look(pairs[0], pairs[1], pairs[2], pairs[3])


def vector_of(look: Look) -> NDArray[np.float32]:
    """Four centres and four spreads, (8,)."""
    return np.array(look[LOOK], dtype=np.float32).T.reshape(-1)


def _novel(cells: Cells, rest: Cells) -> NDArray[np.bool_]:
    """Which cells are the thing: those unlike the background, or all where none or nearly all are."""
    everything = np.ones(len(cells), dtype=np.bool_)
    if len(rest) < _LEAST_CELLS:
        return everything
    background = rest[:: max(1, len(rest) // _SAMPLES)] / _SCALE
    gaps = ((cells / _SCALE)[:, None] - background) ** 2
    rank = int(_COMMON * len(background))
    novelty = np.sqrt(np.partition(gaps.sum(axis=2), rank, axis=1)[:, rank])
    limit = min(_split(novelty), _NOVEL)
    novel = novelty >= max(limit, 0.5 * _NOVEL)
    return novel if novel.sum() >= _LEAST_CELLS else everything


def _split(values: Cells) -> float:
    """The threshold that parts values best into two groups (Otsu)."""
    ordered = np.sort(values)
    count = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)[:-1]
    low, high = sums / count, (ordered.sum() - sums) / (len(ordered) - count)
    best = int(np.argmax(count * (len(ordered) - count) * (high - low) ** 2))
    return float(ordered[best : best + 2].mean())
