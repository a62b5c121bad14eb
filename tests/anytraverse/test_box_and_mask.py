"""Boxes in fractions of an image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import RegionError
from anytraverse.regions import Box

fractions = st.floats(0, 1)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    """Any box."""
    left, right = sorted(draw(st.tuples(fractions, fractions).filter(lambda pair: pair[0] != pair[1])))
    top, bottom = sorted(draw(st.tuples(fractions, fractions).filter(lambda pair: pair[0] != pair[1])))
    return Box(left, top, right, bottom)


@given(boxes(), st.integers(1, 30), st.integers(1, 30))
@settings(max_examples=100)
def test_the_mask_holds_the_pixels_whose_centre_lies_inside(box: Box, height: int, width: int) -> None:
    mask = box.mask(height, width)
    assert mask.shape == (height, width)
    for row in range(height):
        for column in range(width):
            x, y = (column + 0.5) / width, (row + 0.5) / height
            near_edge = (
                min(abs(x - box.left), abs(x - box.right), abs(y - box.top), abs(y - box.bottom)) < 1e-9
            )
            assert near_edge or mask[row, column] == box.contains(x, y)
    assert mask.sum() == mask[box.slices(height, width)].size


@given(boxes(), st.floats(1, 5))
@settings(max_examples=60)
def test_a_grown_box_holds_the_box_and_stays_in_the_image(box: Box, factor: float) -> None:
    grown = box.grown(factor)
    assert grown.left <= box.left + 1e-12
    assert grown.top <= box.top + 1e-12
    assert grown.right >= box.right - 1e-12
    assert grown.bottom >= box.bottom - 1e-12


@pytest.mark.parametrize(
    "sides",
    [
        (0.5, 0, 0.5, 1),
        (0, 0.6, 1, 0.4),
        (-0.1, 0, 1, 1),
        (0, 0, 1.1, 1),
        (math.nan, 0, 1, 1),
        (0, 0, 1, math.inf),
    ],
)
def test_what_is_no_box_is_refused(sides: tuple[float, float, float, float]) -> None:
    with pytest.raises(RegionError):
        Box(*sides)


def test_a_box_is_its_own_bounds() -> None:
    box = Box(0.2, 0.3, 0.6, 0.9)
    assert box.bounds is box
    assert box.centre == pytest.approx((0.4, 0.6))
    assert np.array_equal(Box(0, 0, 1, 1).mask(3, 4), np.ones((3, 4), dtype=bool))
