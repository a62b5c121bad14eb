"""A word proposes its own weight, and whoever turns its sign is asked before."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.preferences import turns_sign
from companion.wire.answers import ForgetWord, SetWord, TapBox
from companion.wire.ids import Reasons
from companion.wire.typed_answers import Tap
from companion.wire.weights import propose, turned

WEIGHT = st.floats(-1.0, 1.0).map(lambda weight: weight + 0.0)
WORD = st.sampled_from(["water", "grass", "bush", "mud", "old drum"])
WORDS = st.dictionaries(WORD, WEIGHT)
REASONS = st.integers(0, 15).map(Reasons)
PLACE, THING = Reasons.UNKNOWN_SCENE, Reasons.UNKNOWN_OBJECT


def sign(weight: float) -> int:
    return (weight > 0) - (weight < 0)


@given(WORD, WORDS, WORDS, REASONS)
def test_a_word_that_is_known_proposes_its_own_weight_and_turns_nothing(
    word: str, in_force: dict[str, float], before: dict[str, float], reasons: Reasons
) -> None:
    found = propose(word, None, in_force, before, reasons)
    known = {**before, **in_force}
    assert found.was == known.get(word)
    assert found.weight == known.get(word, found.weight)
    assert not found.turns


@given(WORD, WEIGHT, WORDS, WORDS, REASONS)
def test_a_weight_that_was_typed_is_taken_and_a_sign_turns_only_from_a_known_one(
    word: str, typed: float, in_force: dict[str, float], before: dict[str, float], reasons: Reasons
) -> None:
    found = propose(word, typed, in_force, before, reasons)
    assert found.weight == typed
    known = {**before, **in_force}
    assert found.turns == (word in known and sign(known[word]) != sign(typed))


@pytest.mark.parametrize(
    ("reasons", "weight"),
    [
        (PLACE, 1.0),
        (THING, -1.0),
        (PLACE | THING, -1.0),
        (Reasons.BLOCKED, -1.0),
        (PLACE | Reasons.BLOCKED, 1.0),
        (Reasons.NONE, 1.0),
    ],
)
def test_a_new_word_is_drivable_for_a_place_and_not_for_a_thing(reasons: Reasons, weight: float) -> None:
    assert propose("log", None, {"grass": 1.0}, {"mud": -1.0}, reasons).weight == weight


@given(WEIGHT, WEIGHT)
def test_a_sign_turned_twice_is_as_it_was(one: float, other: float) -> None:
    assert turns_sign(one, other) == turns_sign(other, one)
    assert not turns_sign(one, one)


@given(WORDS, WORDS, WORDS)
def test_a_question_names_each_word_that_is_turned_and_no_other(
    changes: dict[str, float], in_force: dict[str, float], before: dict[str, float]
) -> None:
    asked = turned([SetWord(*change) for change in changes.items()], in_force, before)
    known = {**before, **in_force}
    for word, weight in changes.items():
        turns = word in known and sign(known[word]) != sign(weight)
        assert (f"{word} was" in asked) == turns
    assert asked.isprintable()


def test_a_question_says_what_it_was_what_to_do_and_what_becomes_drivable() -> None:
    assert turned([SetWord("water", 1.0)], {"water": -1.0}, {}) == (
        "water was -1: repeat it to turn it, then water becomes drivable; nothing was sent"
    )
    box = (0.1, 0.1, 0.5, 0.5)
    both = [Tap("grass", -1.0), TapBox(3, box, "mud", 0.5), ForgetWord("bush")]
    assert turned(both, {"grass": 1.0, "bush": -1.0}, {"mud": -0.5}) == (
        "grass was 1, mud was -0.5: repeat it to turn them, "
        "then grass becomes not drivable, mud becomes drivable; nothing was sent"
    )
