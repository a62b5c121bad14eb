"""What kind of place a frame shows: a unit vector that is alike for like ground under any light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.ground_features import Grid

SAME_PLACE = 0.85
"""Cosine below which the ground is another kind of ground."""

_QUARTILES = (0.25, 0.5, 0.75)  # a thing on less than a quarter of the ground hardly moves them
_FEATURES = [0, 1, 3]  # redness, yellowness, roughness: light changes too much within one place
_MIDDLE = np.array([0.0, 0.15, -2.2])
_RADIAN = np.array([0.1, 0.2, 0.15])  # how much of each feature turns its angle by one radian
_WEIGHT = np.array([1.0, 1.0, 1.5])
_RAW_SAME_PLACE = 0.71  # the fitted threshold for the mean cosine of the angles' differences


def scene_vector(grid: Grid) -> NDArray[np.float32]:
    """The ground in the lower half of the frame as a unit vector, (19,) float32.

    Each quartile of each feature is an angle, so that the dot product of two scenes is a weighted mean of
    cosines of differences. A constant first entry moves the fitted threshold to SAME_PLACE.
    """
    ground = grid[grid.shape[0] // 2 :, :, _FEATURES].reshape(-1, len(_FEATURES))
    quartiles = np.quantile(ground, _QUARTILES, axis=0)
    angles = np.clip((quartiles - _MIDDLE) / _RADIAN, -math.pi / 2, math.pi / 2)
    varying = (1 - SAME_PLACE) / (1 - _RAW_SAME_PLACE)
    share = np.sqrt(varying * _WEIGHT / (_WEIGHT.sum() * len(_QUARTILES)))
    parts = [[math.sqrt(1 - varying)], (share * np.cos(angles)).ravel(), (share * np.sin(angles)).ravel()]
    return np.concatenate(parts).astype(np.float32)
