"""Embeds the scene of a segmented frame as a unit vector."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError

Array = NDArray[np.float32]

ROWS, COLUMNS = 4, 6


def layout_vector(values: Array, shares: bool) -> Array:
    """Embed the layout of the classes from their values, (n, h, w): a unit vector, (n * 24,) or (n * 48,).

    The entries are the square roots of the mean values in a grid of 4 x 6 cells. So the cosine of two vectors
    is the mean of Bhattacharyya's coefficient over the cells. Without shares there are entries for each class
    and for its absence. Two meadows of the same layout are one place by this embedding.
    """
    cells = _means(values)
    if not shares:
        cells = np.concatenate([cells, 1.0 - cells])
    return _unit(np.sqrt(np.maximum(cells, 0.0)).ravel())


def feature_vector(features: Array) -> Array:
    """Embed mean and standard deviation of the features, (d, h, w), in the upper and lower half: (4 d,)."""
    rows = max(1, features.shape[1] // 2)
    halves = features[:, :rows], features[:, -rows:]
    figures = [figure for half in halves for figure in (half.mean(axis=(1, 2)), half.std(axis=(1, 2)))]
    return _unit(np.concatenate(figures))


def _means(values: Array) -> NDArray[np.float64]:
    """Average each map in a grid of cells; a map smaller than the grid gives its nearest place."""
    height, width = values.shape[1:]
    rows = (np.arange(ROWS) * height) // ROWS
    columns = (np.arange(COLUMNS) * width) // COLUMNS
    sums = np.add.reduceat(np.add.reduceat(values.astype(np.float64), rows, axis=1), columns, axis=2)
    deep = np.maximum(np.diff(np.append(rows, height)), 1)
    wide = np.maximum(np.diff(np.append(columns, width)), 1)
    means: NDArray[np.float64] = sums / (deep[:, None] * wide)
    return means


def _unit(vector: NDArray[np.floating]) -> Array:
    """Scale to unit norm. Raises PerceiverError for 0 and for what is not finite."""
    length = float(np.linalg.norm(vector))
    if not np.isfinite(length) or length == 0.0:
        raise PerceiverError("the scene's embedding is empty or not finite")
    return np.asarray(vector / length, dtype=np.float32)
