"""Words of the built-in network: what they explain, and how kinds of ground compete by colour."""

from __future__ import annotations

import numpy as np

from anytraverse.perception.builtin.network import attention
from anytraverse.perception.builtin.words import GROUND_WORDS, colour_fits, reach, word_tables
from anytraverse.training.classes import CLASSES, UNKNOWN

BROWN, GREY = (0.17, 0.34, -0.1), (0.02, 0.04, 0.1)
POINTS = np.array([[BROWN, GREY]], dtype=np.float32)
"""Two points of one trail."""


def trail() -> np.ndarray:
    """Posteriors of two points that are surely trail, (C, 1, 2)."""
    found = np.full((len(CLASSES), 1, 2), 1e-3, dtype=np.float32)
    found[0] = 1 - 1e-3 * (len(CLASSES) - 1)
    return found


def asked(*concepts: str) -> np.ndarray:
    return attention(trail(), *word_tables(concepts, CLASSES), 4.0, colour_fits(concepts, POINTS))


def test_every_word_explains_classes_of_the_network() -> None:
    covers, own = word_tables(tuple(GROUND_WORDS), CLASSES)
    assert (covers.max(axis=1) == 1).all()
    assert ((own > 0) <= (covers > 0)).all()
    assert ((own.max(axis=0) > 0) == (covers.max(axis=0) > 0)).all()


def test_a_broad_word_leaves_a_class_to_the_word_that_names_it() -> None:
    grass = CLASSES.index("grass")
    assert word_tables(("vegetation",), CLASSES)[1][0, grass] > 0
    covers, own = word_tables(("vegetation", "grass"), CLASSES)
    assert own[:, grass].tolist() == [0.0, 1.0]
    assert covers[:, grass].tolist() == [1.0, 1.0]


def test_a_rock_by_name_explains_what_is_of_its_colour_and_an_obstacle_everything_strange() -> None:
    points = np.array([[(-0.03, -0.05, 0.3), (0.9, 0.8, -0.2)]], dtype=np.float32)
    strange = np.full((len(CLASSES), 1, 2), 1e-3, dtype=np.float32)
    strange[UNKNOWN] = 1 - 1e-3 * (len(CLASSES) - 1)
    for words, explained in ((("rock",), [True, False]), (("rock", "obstacle"), [True, True])):
        fits = colour_fits(words, points)
        found = attention(strange, *word_tables(words, CLASSES), 4.0, fits, reach(words, fits))
        assert (found.max(axis=0)[0] > 0.5).tolist() == explained
    assert reach(("grass", "dirt"), colour_fits(("grass", "dirt"), points)) is None


def test_one_kind_of_ground_asked_for_alone_is_the_whole_trail() -> None:
    assert asked("gravel").min() > 0.9
    assert colour_fits(("grass", "trail"), POINTS) is None


def test_kinds_of_ground_compete_by_colour() -> None:
    dirt, gravel = asked("dirt", "gravel")[:, 0]
    assert min(dirt[0], gravel[1]) > 0.9
    assert max(gravel[0], dirt[1]) < 0.5


def test_a_trail_is_unknown_to_words_of_other_things() -> None:
    assert asked("tree", "sky", "water").max() < 0.05
