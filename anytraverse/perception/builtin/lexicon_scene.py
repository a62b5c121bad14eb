"""Embeds the scene of a frame for the lexicon perceiver: similar ground gives similar unit vectors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.builtin.features import Grid

SAME_PLACE = 0.85
"""Cosine below which the ground is of another kind."""

_ROWS = (0.47, 0.64)  # of the image's height: the ground some metres ahead, with what grows beside the path
_FEATURES = [0, 1, 3]  # redness, yellowness, roughness; not light, which varies too much within one place
_RADIAN = np.array([0.07, 0.08, 0.6], dtype=np.float32)  # difference of each feature that is one radian
_WEIGHT = np.array([1.0, 1.0, 0.3], dtype=np.float32)
_FITTED = 0.48  # best threshold on the cosine of the varying entries alone, on the simulated trail
_VARYING = (1 - SAME_PLACE) / (1 - _FITTED)


def scene_vector(grid: Grid) -> NDArray[np.float32]:
    """Embed the ground ahead as a unit vector, (7,) float32.

    The features of a cell are taken as angles. The vector holds the means of their cosines and sines over
    all cells (a kernel mean embedding). So mixed ground lies between its parts, and a single thing turns the
    vector by little more than its share of the view. The constant first entry raises the threshold from
    `_FITTED` to SAME_PLACE.
    """
    height = grid.shape[0]
    top = int(_ROWS[0] * height)
    ground = grid[top : max(top + 1, int(_ROWS[1] * height)), :, _FEATURES]
    angles = ground.reshape(-1, len(_FEATURES)) / _RADIAN
    means = np.concatenate([np.cos(angles).mean(axis=0), np.sin(angles).mean(axis=0)])
    means *= np.sqrt(np.concatenate([_WEIGHT, _WEIGHT]))
    means *= math.sqrt(_VARYING) / max(float(np.linalg.norm(means)), 1e-6)
    vector = np.concatenate([[math.sqrt(1 - _VARYING)], means])
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float32)
