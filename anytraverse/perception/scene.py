"""What kind of place a frame shows: a unit vector that is alike for like places under any light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.ground_features import LOOK, Grid

_SHARES = (0.25, 0.5, 0.75)


def scene_statistics(grid: Grid) -> NDArray[np.float32]:
    """Quartiles of colour, light and roughness in the upper and the lower half, (24,).

    A thing on less than a quarter of a half hardly moves a quartile.
    """
    middle = max(1, grid.shape[0] // 2)
    halves = (grid[:middle], grid[-middle:])
    quartiles = [np.quantile(half[..., LOOK].reshape(-1, 4), _SHARES, axis=0) for half in halves]
    return np.concatenate([each.ravel() for each in quartiles]).astype(np.float32)


def scene_vector(grid: Grid) -> NDArray[np.float32]:
    """The scene as a unit vector."""
    s = scene_statistics(grid)
    return s / np.linalg.norm(s)
