"""Describes kinds of ground by Gaussians over features, and calculates how well a frame fits them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.perception.builtin.features import LOOK, Grid
from anytraverse.regions import Box

FITS = 3.0  # distance from a look's centre, in spreads, at which the fit of a cell is one half
_STEEPNESS = 3.0  # slope of the logistic function at that distance
_RIVALRY = 0.5  # exponent of the likelihood ratio by which a prompt is lowered below a better one
_ROW_SOFTNESS = 0.03  # of the image's height: distance outside of a look's rows that counts as one spread


class Look(NamedTuple):
    """Holds centre and spread of four features, and the rows (0 top, 1 bottom) in which the look occurs."""

    redness: tuple[float, float]
    yellowness: tuple[float, float]
    light: tuple[float, float]
    roughness: tuple[float, float]
    rows: tuple[float, float] = (0.0, 1.0)


def attention(grid: Grid, prompts: Sequence[Sequence[Look]]) -> NDArray[np.float32]:
    """Calculate how well each cell fits each prompt's looks, (len(prompts), h, w) in [0, 1].

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
    """Calculate the squared Mahalanobis distance of each cell to each look, (looks, cells)."""
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
    """Return the looks' centres and spreads, (looks, 4) each."""
    curves = np.array([look[LOOK] for look in looks], dtype=np.float32)
    return curves[..., 0], curves[..., 1]


Mask = NDArray[np.bool_]

_SCALE = np.array([0.08, 0.08, 0.3, 1.0], dtype=np.float32)
"""Differences in redness, yellowness, light and roughness that have equal weight. Roughness counts little,
since it is high at every edge."""
_LEAST = np.array([0.05, 0.06, 0.3, 0.5], dtype=np.float32)
"""The least spreads of a learnt look: the thing will be seen from other distances and in other light."""
_MOST = np.array([0.1, 0.12, 0.5, 0.8], dtype=np.float32)
_VIVID = np.array([0.12, 0.12, 0.0, 0.0], dtype=np.float32)
"""How much spreads widen with the vividness of a colour: vivid colours fade as a channel saturates."""
_NEARER = np.array([1.1, 1.1, 1.0, 1.0], dtype=np.float32)
"""Factors on the learnt centre: colours get purer as a thing comes nearer and fewer cells are mixed."""
_LEAST_CELLS = 6
_REACH = 3.0  # factor on the box, within which the thing may continue
_LEAST_BACKGROUND = 0.15  # least share of the image that serves as background
_SAMPLES = 900  # cells of the background to compare with
_COMMON = 0.04  # share of the background that a cell must resemble to count as background
_NOVEL = 1.5  # scaled difference from the background above which a cell is not background
_CORE = 0.75  # share of the highest difference in the box above which a cell surely shows the thing
_SAME = 2.0  # scaled difference from the core below which neighbouring cells belong to the thing


def learn_look(grid: Grid, box: Box) -> Look:
    """Learn the look of what the box shows. Raises ExampleError when the box is too small."""
    inside = box.mask(*grid.shape[:2])
    if inside.sum() < _LEAST_CELLS:
        raise ExampleError("the box is too small to learn from: draw a larger one around the thing")
    thing, pure = _find_thing(grid[..., LOOK] / _SCALE, inside, box)
    centre = np.median(grid[pure][:, LOOK], axis=0) * _NEARER
    spread = np.clip(grid[thing][:, LOOK].std(axis=0), _LEAST, _MOST) + _VIVID * np.abs(centre)
    return look_of(np.concatenate([centre, spread]))


def look_of(vector: NDArray[np.float32]) -> Look:
    """Make a look from a vector of four centres and four spreads, (8,)."""
    pairs = [(float(centre), float(spread)) for centre, spread in vector.reshape(2, 4).T]
    return Look(pairs[0], pairs[1], pairs[2], pairs[3])


def vector_of(look: Look) -> NDArray[np.float32]:
    """Return a look's four centres and four spreads, (8,)."""
    return np.array(look[LOOK], dtype=np.float32).T.reshape(-1)


def _find_thing(cells: NDArray[np.float32], inside: Mask, box: Box) -> tuple[Mask, Mask]:
    """Return masks of the thing's cells and of the half of them that differs most from the background.

    The thing is the box's cells that differ most from the background, with similar connected cells in and
    around the box; the whole box where none differs enough.
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
    """Choose the background to compare a thing with: the cells at its height in the image and below.

    The cells above are left out, since grey things resemble the sky. Where too few cells remain, all cells
    outside of the box count.
    """
    level = np.zeros_like(inside)
    level[np.flatnonzero(inside.any(axis=1))[0] :] = True
    for candidate in (level & ~reach, level & ~inside):
        if candidate.mean() >= _LEAST_BACKGROUND:
            return candidate
    return ~inside


def _distance_to(background: NDArray[np.float32], cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """Calculate how much each cell differs from what is common in the background, (cells,)."""
    sample = background[:: max(1, len(background) // _SAMPLES)]
    gaps = (cells**2).sum(axis=1)[:, None] + (sample**2).sum(axis=1) - 2 * cells @ sample.T
    rank = int(_COMMON * len(sample))
    nearest = np.partition(gaps, rank, axis=1)[:, rank]
    return np.sqrt(np.maximum(nearest, 0.0)).astype(np.float32)
