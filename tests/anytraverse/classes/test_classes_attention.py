"""What the asked classes' shares become: attention that leaves what nobody asked about uncertain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from anytraverse.perception.classes.attention import attention_of, resized_to
from anytraverse.perception.classes.scene import feature_vector, layout_vector

COUNT = 6
SCORES = arrays.arrays(
    np.float32, (COUNT, 2, 3), elements=st.floats(-90, 90, width=32, allow_nan=False, allow_infinity=False)
)
ASKED = st.lists(st.integers(0, COUNT - 1), min_size=1, max_size=8)


def softmax(scores: NDArray[np.float32]) -> NDArray[np.float32]:
    powers = np.exp(scores - scores.max(axis=0))
    shares: NDArray[np.float32] = powers / powers.sum(axis=0)
    return shares


@settings(max_examples=60)
@given(scores=SCORES, asked=ASKED)
def test_uncertainty_is_the_share_of_the_classes_that_nobody_asked_for(
    scores: NDArray[np.float32], asked: list[int]
) -> None:
    shares = softmax(scores)
    attention = attention_of(shares, asked, shares=True)
    assert attention.shape == (len(asked), 2, 3)
    assert attention.dtype == np.float32
    assert attention.min() >= 0.0
    assert attention.max() <= 1.0
    known = shares[sorted(set(asked))].sum(axis=0)
    np.testing.assert_allclose(attention.max(axis=0), known, atol=1e-5)


@settings(max_examples=40)
@given(scores=SCORES, asked=ASKED, more=st.integers(0, COUNT - 1))
def test_asking_for_more_never_makes_a_place_more_uncertain(
    scores: NDArray[np.float32], asked: list[int], more: int
) -> None:
    shares = softmax(scores)
    fewer = attention_of(shares, asked, shares=True).max(axis=0)
    assert (attention_of(shares, [*asked, more], shares=True).max(axis=0) >= fewer - 1e-5).all()


def test_of_two_asked_classes_the_likelier_gets_all_that_is_known() -> None:
    shares = np.array([0.5, 0.25, 0.2, 0.05], dtype=np.float32).reshape(4, 1, 1)
    maps = attention_of(shares, [0, 1], shares=True)
    np.testing.assert_allclose(maps.ravel(), [0.75, 0.375], rtol=1e-6)


def test_classes_that_vanish_altogether_have_no_attention() -> None:
    shares = np.array([0.0, 0.0, 1.0], dtype=np.float32).reshape(3, 1, 1)
    assert attention_of(shares, [0, 1], shares=True).ravel().tolist() == [0.0, 0.0]


def test_values_without_shares_are_the_attention() -> None:
    values = np.array([0.9, 0.8, 0.1], dtype=np.float32).reshape(3, 1, 1)
    assert attention_of(values, [1, 0, 1], shares=False).ravel().tolist() == pytest.approx([0.8, 0.9, 0.8])


@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (24, 32), (7, 5)])
def test_the_layout_of_any_map_is_a_unit_vector_of_one_length(shape: tuple[int, int]) -> None:
    shares = softmax(np.random.default_rng(0).standard_normal((5, *shape), dtype=np.float32))
    vector = layout_vector(shares, shares=True)
    assert vector.shape == (5 * 24,)
    assert float(vector @ vector) == pytest.approx(1.0, abs=1e-5)
    assert float(feature_vector(shares) @ feature_vector(shares)) == pytest.approx(1.0, abs=1e-5)


def test_places_without_a_class_in_common_are_at_right_angles() -> None:
    left, right = np.zeros((2, 2, 8, 8), dtype=np.float32)
    left[0], right[1] = 1.0, 1.0
    assert layout_vector(left, shares=True) @ layout_vector(right, shares=True) == pytest.approx(0.0)


def test_a_map_is_brought_to_another_shape_by_its_nearest_places() -> None:
    plane = np.array([[0.0, 1.0], [2.0, 3.0]], dtype=np.float32)
    assert resized_to(plane, (4, 2)).tolist() == [[0, 1], [0, 1], [2, 3], [2, 3]]
    assert resized_to(plane, (1, 1)).tolist() == [[3.0]]
