"""Interpolates tables of positions for another number of patches, as the models do it themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]


def fit_positions(table: Array, side: int) -> Array:
    """Interpolate the position table (1 + n * n, width) for a grid of side x side: bicubic, as in CLIPSeg."""
    return np.concatenate([table[:1], fit_grid(table[1:], side, "bicubic")])


def _cubic_matrix(old: int, new: int) -> NDArray[np.float64]:
    """Make the matrix (new, old) that interpolates `old` samples at the places of `new` ones.

    As torch does it: a = -0.75, no antialiasing, pixel centres at half integers, edges repeated.
    """
    matrix = np.zeros((new, old))
    for y in range(new):
        middle = (y + 0.5) * old / new - 0.5
        base = int(np.floor(middle))
        for tap in range(base - 1, base + 3):
            matrix[y, min(max(tap, 0), old - 1)] += _cubic(abs(middle - tap))
    return matrix


def _cubic(distance: float, a: float = -0.75) -> float:
    if distance <= 1:
        return ((a + 2) * distance - (a + 3)) * distance * distance + 1
    return ((a * distance - 5 * a) * distance + 8 * a) * distance - 4 * a if distance < 2 else 0.0


def fit_grid(grid: Array, side: int, kind: str) -> Array:
    """Interpolate the positions of patches, (n * n, width), for a grid of side x side.

    kind: "bicubic", or "antialiased": bilinear with antialiasing, as torch does both. An equal grid stays.
    """
    old = round(len(grid) ** 0.5)
    if old == side:
        return grid
    matrix = _cubic_matrix(old, side) if kind == "bicubic" else _triangle_matrix(old, side)
    cells = grid.astype(np.float64).reshape(old, old, -1)
    fitted = np.einsum("yi,xj,ijc->yxc", matrix, matrix, cells, optimize=True)
    return np.asarray(fitted.reshape(side * side, -1), dtype=np.float32)


def _triangle_matrix(old: int, new: int) -> NDArray[np.float64]:
    """Make the matrix (new, old) of an antialiased bilinear interpolation, weights of sum 1."""
    scale = old / new
    reach = max(scale, 1.0)
    distance = np.abs((np.arange(new)[:, None] + 0.5) * scale - (np.arange(old) + 0.5)) / reach
    matrix = np.maximum(1.0 - distance, 0.0)
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))
