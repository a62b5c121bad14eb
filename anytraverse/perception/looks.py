"""Looks: how a kind of ground appears, as broad bell curves over features, and how well a frame fits them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.ground_features import LOOK, Grid

FITS = 3.0  # spreads away from a look's centre at which a cell fits it by half
_STEEPNESS = 3.0  # how fast the fit falls there
_RIVALRY = 0.5  # how strongly a word yields to one that explains a cell better
_ROW_SOFTNESS = 0.03  # of the image's height: how fast a look ends above and below its rows


class Look(NamedTuple):
    """Centre and spread of four features, and the rows (0 top, 1 bottom) in which the look occurs."""

    redness: tuple[float, float]
    yellowness: tuple[float, float]
    light: tuple[float, float]
    roughness: tuple[float, float]
    rows: tuple[float, float] = (0.0, 1.0)


def attention(grid: Grid, prompts: Sequence[Sequence[Look]]) -> NDArray[np.float32]:
    """How well each cell fits each prompt's looks, (len(prompts), h, w) in [0, 1].

    The best fit of a cell is absolute: it depends on no other prompt. Where several prompts explain a cell,
    those that explain it less well are lowered in proportion to their likelihood.
    """
    height, width = grid.shape[:2]
    if not prompts:
        return np.zeros((0, height, width), dtype=np.float32)
    looks = [look for own in prompts for look in own]
    starts = np.cumsum([0, *(len(own) for own in prompts[:-1])])
    distance = _squared_distance(grid, looks)
    spreads = _curves(looks)[1]
    likelihood = -0.5 * distance - np.log(spreads).sum(axis=1)[:, None]
    likelihood = np.maximum.reduceat(likelihood, starts, axis=0)
    closest = np.sqrt(np.minimum.reduce(distance, axis=0))
    fit = 1 / (1 + np.exp(_STEEPNESS * (closest - FITS)))
    shares = np.exp(_RIVALRY * (likelihood - likelihood.max(axis=0)))
    smooth = np.stack([_smoothed(each.reshape(height, width)) for each in (fit, *shares)])
    maps: NDArray[np.float32] = smooth[0] * smooth[1:] / smooth[1:].max(axis=0)
    return maps


def _smoothed(values: NDArray[np.float32]) -> NDArray[np.float32]:
    blurred = cv2.GaussianBlur(values.astype(np.float32), (5, 5), 0)
    return np.asarray(blurred, dtype=np.float32).reshape(values.shape)


def _squared_distance(grid: Grid, looks: Sequence[Look]) -> NDArray[np.float32]:
    """Squared Mahalanobis distance of each cell to each look, (looks, cells)."""
    cells = grid[..., LOOK].reshape(-1, 4)
    centres, spreads = _curves(looks)
    weights = 1 / spreads**2
    distance = weights @ (cells * cells).T - 2 * (weights * centres) @ cells.T
    distance += (weights * centres**2).sum(axis=1)[:, None]
    rows = np.repeat(grid[:, 0, -1], grid.shape[1])
    top, bottom = np.array([look.rows for look in looks], dtype=np.float32).T
    outside = np.maximum(top[:, None] - rows, rows - bottom[:, None]).clip(min=0.0) / _ROW_SOFTNESS
    return np.asarray(np.maximum(distance, 0.0) + outside**2, dtype=np.float32)


def _curves(looks: Sequence[Look]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Centres and spreads, (looks, 4) each."""
    curves = np.array([look[LOOK] for look in looks], dtype=np.float32)
    return curves[..., 0], curves[..., 1]
