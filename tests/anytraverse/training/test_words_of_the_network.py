"""Words of the built-in network: what they explain, what they share, and how colours tell them apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.perception.builtin.attention import attention
from anytraverse.perception.builtin.words import (
    GROUND_WORDS,
    colour_fits,
    own_weights,
    reach,
    relative_fits,
)
from anytraverse.training.classes import CLASSES, DRIVABLE, UNKNOWN

BROWN, GREY = (0.17, 0.34, -0.1), (0.02, 0.04, 0.1)
POINTS = np.array([[BROWN, GREY]], dtype=np.float32)
"""Two points of one trail."""
GRASS, TREE = CLASSES.index("grass"), CLASSES.index("high vegetation")
Floats = NDArray[np.float32]


def surely(index: int, points: int = 2) -> Floats:
    """Probabilities of points that are surely of one class, (C, 1, points)."""
    found = np.full((len(CLASSES), 1, points), 1e-3, dtype=np.float32)
    found[index] = 1 - 1e-3 * (len(CLASSES) - 1)
    return found


def asked(probabilities: Floats, *concepts: str, sides: list[bool | None] | None = None) -> Floats:
    own, fits = own_weights(concepts, CLASSES), colour_fits(concepts, POINTS)
    kinds = None if fits is None else relative_fits(fits, own > 0)
    return attention(probabilities, own, sides or [None] * len(concepts), kinds, reach(concepts, fits))


def any_probabilities(seed: int, points: int = 12) -> Floats:
    shares = np.random.default_rng(seed).gamma(0.4, size=(len(CLASSES), 1, points)) + 1e-6
    return np.asarray(shares / shares.sum(axis=0), dtype=np.float32)


def test_every_word_explains_classes_of_the_network() -> None:
    own = own_weights(tuple(GROUND_WORDS), CLASSES)
    covered = {CLASSES.index(name) for word in GROUND_WORDS.values() for name in word.covers}
    assert covered == set(np.flatnonzero(own.max(axis=0) > 0))
    for concept in GROUND_WORDS:
        alone = own_weights((concept,), CLASSES)[0]
        assert {CLASSES[index] for index in np.flatnonzero(alone)} == set(GROUND_WORDS[concept].covers)


def test_a_broad_word_leaves_a_class_to_the_word_that_names_it() -> None:
    assert own_weights(("vegetation",), CLASSES)[0, GRASS] > 0
    assert own_weights(("vegetation", "grass"), CLASSES)[:, GRASS].tolist() == [0.0, 1.0]


words = st.lists(st.sampled_from(sorted(GROUND_WORDS)), min_size=1, max_size=8)
signs = st.lists(st.sampled_from([True, False, None]), min_size=8, max_size=8)
plain_words = st.lists(
    st.sampled_from([name for name, word in GROUND_WORDS.items() if not word.colour]),
    min_size=1,
    max_size=6,
    unique=True,
)


@settings(max_examples=60)
@given(asked_words=words, drivable=signs, seed=st.integers(0, 10_000))
def test_attention_stays_between_0_and_1(
    asked_words: list[str], drivable: list[bool | None], seed: int
) -> None:
    found = asked(any_probabilities(seed, 2), *asked_words, sides=drivable[: len(asked_words)])
    assert found.shape == (len(asked_words), 1, 2)
    assert np.isfinite(found).all()
    assert found.min() >= 0
    assert found.max() <= 1


@settings(max_examples=60)
@given(asked_words=plain_words, drivable=signs, seed=st.integers(0, 10_000))
def test_a_side_explains_the_sum_of_its_classes_and_what_is_left_is_uncertain(
    asked_words: list[str], drivable: list[bool | None], seed: int
) -> None:
    probabilities, sides = any_probabilities(seed), drivable[: len(asked_words)]
    own = own_weights(asked_words, CLASSES)
    found = attention(probabilities, own, sides)
    masses = []
    for side in set(sides):
        members = [index for index, each in enumerate(sides) if each == side]
        mass = probabilities[own[members].max(axis=0) > 0].sum(axis=0)
        assert found[members].max(axis=0) == pytest.approx(mass, abs=1e-5)
        masses.append(mass)
    assert 1 - found.max(axis=0) == pytest.approx(1 - np.max(masses, axis=0), abs=1e-5)


@settings(max_examples=60)
@given(asked_words=plain_words, against=plain_words, seed=st.integers(0, 10_000))
def test_a_word_of_the_other_side_makes_no_ground_drivable(
    asked_words: list[str], against: list[str], seed: int
) -> None:
    probabilities, both = any_probabilities(seed), [*asked_words, *against]
    alone = attention(probabilities, own_weights(asked_words, CLASSES), [True] * len(asked_words))
    sides = [True] * len(asked_words) + [False] * len(against)
    beside = attention(probabilities, own_weights(both, CLASSES), sides)[: len(asked_words)]
    assert (beside.max(axis=0) <= alone.max(axis=0) + 1e-5).all()


def test_ground_between_two_drivable_names_is_as_known_as_both_together() -> None:
    half = np.zeros((len(CLASSES), 1, 1), np.float32)
    half[[DRIVABLE[0], GRASS, TREE], 0, 0] = 0.4, 0.4, 0.2
    words = own_weights(("trail", "grass"), CLASSES)
    assert attention(half, words, [True, True]).max() == pytest.approx(0.8)
    assert attention(half, words, [True, False]).max() == pytest.approx(0.4)
    assert attention(half, words[:0], []).shape == (0, 1, 1)


def test_a_rock_by_name_explains_what_is_of_its_colour_and_an_obstacle_everything_strange() -> None:
    points = np.array([[(-0.03, -0.05, 0.3), (0.9, 0.8, -0.2)]], dtype=np.float32)
    for concepts, explained in ((("rock",), [True, False]), (("rock", "obstacle"), [True, True])):
        own, fits = own_weights(concepts, CLASSES), colour_fits(concepts, points)
        assert fits is not None
        kinds, far = relative_fits(fits, own > 0), reach(concepts, fits)
        found = attention(surely(UNKNOWN), own, [False] * len(concepts), kinds, far)
        assert (found.max(axis=0)[0] > 0.5).tolist() == explained
    assert reach(("grass", "dirt"), colour_fits(("grass", "dirt"), points)) is None


def test_one_kind_of_ground_asked_for_alone_is_the_whole_trail() -> None:
    assert asked(surely(0), "gravel").min() > 0.9
    assert colour_fits(("grass", "trail"), POINTS) is None


@pytest.mark.parametrize("sides", [[None, None], [True, True], [True, False]])
def test_kinds_of_ground_compete_by_colour(sides: list[bool | None]) -> None:
    dirt, gravel = asked(surely(0), "dirt", "gravel", sides=sides)[:, 0]
    assert min(dirt[0], gravel[1]) > 0.9
    assert max(gravel[0], dirt[1]) < 0.5


def test_a_trail_is_unknown_to_words_of_other_things() -> None:
    assert asked(surely(0), "tree", "sky", "water").max() < 0.05
