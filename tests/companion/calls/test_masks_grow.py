"""Masks become coarse and grow, cell by cell, as a slow and plain rule says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from companion.calls.tracking import below, coarse, connected, resized, wider

Mask = NDArray[np.bool_]
SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 9))


@st.composite
def pairs(draw: st.DrawFn) -> tuple[Mask, Mask]:
    shape = draw(SHAPES)
    masks = arrays.arrays(np.bool_, shape)
    return draw(masks), draw(masks)


def _grown(seed: Mask, within: Mask, steps: int) -> Mask:
    height, width = seed.shape
    for _ in range(steps):
        spread = seed.copy()
        for row in range(height):
            for column in range(width):
                beside = ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
                spread[row, column] |= any(
                    0 <= r < height and 0 <= c < width and seed[r, c] for r, c in beside
                )
        seed = spread & within
    return seed


@given(pairs(), st.integers(0, 12))
def test_a_mask_grows_inside_another_by_so_many_cells(masks: tuple[Mask, Mask], steps: int) -> None:
    seed, within = masks
    assert np.array_equal(connected(seed, within, steps), _grown(seed, within, steps))


@given(pairs())
def test_a_wider_mask_has_one_cell_more_on_each_side(masks: tuple[Mask, Mask]) -> None:
    assert np.array_equal(wider(masks[0]), _grown(masks[0], np.ones_like(masks[0]), 1))


@pytest.mark.slow
@given(pairs(), st.integers(0, 12))
def test_below_a_mask_is_each_cell_that_has_one_of_it_above_and_near_its_column(
    masks: tuple[Mask, Mask], aside: int
) -> None:
    mask, found = masks[0], below(masks[0], aside)
    for row, column in np.ndindex(*mask.shape):
        left = max(0, column - aside)
        assert found[row, column] == mask[: row + 1, left : column + aside + 1].any()


@pytest.mark.parametrize("shape", [(9, 7), (96, 97), (200, 300)])
def test_a_large_mask_becomes_96_cells_a_side_and_each_of_its_pixels_sets_its_cell(
    shape: tuple[int, int],
) -> None:
    mask = np.random.default_rng(0).random(shape) < 0.1
    cells = np.zeros((min(shape[0], 96), min(shape[1], 96)), np.bool_)
    for row, column in np.argwhere(mask):
        cells[row * cells.shape[0] // shape[0], column * cells.shape[1] // shape[1]] = True
    assert np.array_equal(coarse(mask), cells)
    assert resized(cells, *shape)[mask].all()
