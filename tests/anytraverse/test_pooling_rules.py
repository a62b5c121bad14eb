"""Weighted max pooling and 1 - max."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.pooling import one_minus_max, weighted_max

Maps = NDArray[np.float32]
levels = st.sampled_from([0.0, 0.25, 0.5, 1.0]) | st.floats(0, 1, width=32)
signs = st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0]) | st.floats(-1, 1, width=32)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Maps, Maps]:
    """Attention of up to five words on six pixels, and weights; ties are frequent."""
    count = draw(st.integers(1, 5))
    attention = draw(st.lists(levels, min_size=6 * count, max_size=6 * count))
    weights = draw(st.lists(signs, min_size=count, max_size=count))
    return np.array(attention, dtype=np.float32).reshape(count, 2, 3), np.array(weights, dtype=np.float32)


@given(scenes())
@settings(max_examples=150)
def test_each_pixel_takes_the_weighted_value_of_largest_size_and_of_equals_the_lowest(
    scene: tuple[Maps, Maps],
) -> None:
    attention, weights = scene
    signed = weighted_max(attention, weights)
    assert signed.dtype == np.float32
    for row, column in np.ndindex(2, 3):
        weighted = [np.float32(w * m) for w, m in zip(weights, attention[:, row, column], strict=True)]
        assert signed[row, column] == min(weighted, key=lambda value: (-abs(value), value))
    assert np.abs(signed).max() <= 1


@given(scenes(), st.permutations(range(5)))
@settings(max_examples=60)
def test_the_order_of_the_words_changes_nothing(scene: tuple[Maps, Maps], order: list[int]) -> None:
    attention, weights = scene
    order = [index for index in order if index < len(weights)]
    assert np.array_equal(weighted_max(attention, weights), weighted_max(attention[order], weights[order]))
    assert np.array_equal(one_minus_max(attention), one_minus_max(attention[order]))


@given(scenes())
@settings(max_examples=60)
def test_pooling_leaves_its_input_alone(scene: tuple[Maps, Maps]) -> None:
    for array in scene:
        array.flags.writeable = False
    weighted_max(*scene)
    one_minus_max(scene[0])


def test_one_word_is_its_attention_times_its_weight() -> None:
    attention = np.array([[[0.0, 0.5, 1.0]]], dtype=np.float32)
    assert weighted_max(attention, np.array([-0.5], dtype=np.float32)).tolist() == [[0, -0.25, -0.5]]
    assert one_minus_max(attention).tolist() == [[1, 0.5, 0]]


def test_weights_of_zero_make_nothing_drivable() -> None:
    attention = np.ones((2, 1, 2), dtype=np.float32)
    assert not weighted_max(attention, np.zeros(2, dtype=np.float32)).any()


def test_not_drivable_wins_a_tie() -> None:
    attention = np.full((2, 1, 1), 0.7, dtype=np.float32)
    assert weighted_max(attention, np.array([1, -1], dtype=np.float32)) == -np.float32(0.7)


def test_without_words_nothing_is_drivable_and_all_is_uncertain() -> None:
    nothing = np.zeros((0, 2, 3), dtype=np.float32)
    assert weighted_max(nothing, np.zeros(0, dtype=np.float32)).tolist() == [[0] * 3] * 2
    assert one_minus_max(nothing).tolist() == [[1] * 3] * 2


@pytest.mark.parametrize("word", [0, 1])
@pytest.mark.parametrize("weight", [1.0, 0.0, -1.0])
def test_not_a_number_stays_not_a_number(word: int, weight: float) -> None:
    attention = np.full((2, 1, 2), 0.9, dtype=np.float32)
    attention[word, 0, 0] = np.nan
    signed = weighted_max(attention, np.array([weight, 0.3], dtype=np.float32))
    assert np.isnan(signed).tolist() == [[True, False]]
    assert np.isnan(one_minus_max(attention)).tolist() == [[True, False]]
