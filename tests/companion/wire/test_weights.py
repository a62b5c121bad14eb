"""A word proposes its own weight, and whoever turns its sign is asked before."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.operations import ForgetWord, Operation, OtherPlace, SetWord, Tap
from anytraverse.preferences import turns_sign
from companion.wire.typed_answers import NO_BOX, NO_FRAME
from companion.wire.words_text import own_weight, turned

WEIGHT = st.floats(-1.0, 1.0).map(lambda weight: weight + 0.0)
WORD = st.sampled_from(["water", "grass", "bush", "mud", "old drum"])
WORDS = st.dictionaries(WORD, WEIGHT)


@given(WORD, WORDS, WORDS)
def test_the_weight_in_force_is_a_words_own_before_the_one_given_last(
    word: str, in_force: dict[str, float], before: dict[str, float]
) -> None:
    assert own_weight(word, in_force, before) == {**before, **in_force}.get(word)


@given(WEIGHT, WEIGHT)
def test_a_sign_turned_twice_is_as_it_was(one: float, other: float) -> None:
    assert turns_sign(one, other) == turns_sign(other, one)
    assert turns_sign(one, other) == ((one > 0) != (other > 0))


def test_a_weight_of_0_is_not_drivable_either() -> None:
    assert turned([SetWord("water", 0.0)], {"water": -1.0}, {}, {}) == ""
    assert "mud becomes drivable" in turned([SetWord("mud", 0.1)], {"mud": 0.0}, {}, {})
    assert "grass becomes not drivable" in turned([SetWord("grass", 0.0)], {"grass": 1.0}, {}, {})


def test_before_the_words_are_read_each_unknown_one_may_turn() -> None:
    changes = [SetWord("water", 1.0), SetWord("grass", 1.0)]
    assert turned(changes, {"grass": 1.0}, {}, {}, read=False) == (
        "water is not read yet: repeat it to turn it, then water becomes drivable; nothing was sent"
    )
    assert turned(changes, {"grass": 1.0}, {}, {}) == ""


@given(WORDS, WORDS, WORDS)
def test_a_question_names_each_word_that_is_turned_and_no_other(
    changes: dict[str, float], in_force: dict[str, float], before: dict[str, float]
) -> None:
    asked = turned([SetWord(*change) for change in changes.items()], in_force, before, {})
    known = {**before, **in_force}
    for word, weight in changes.items():
        turns = word in known and (known[word] > 0) != (weight > 0)
        assert (f"{word} was" in asked) == turns
    assert asked.isprintable()


def test_a_question_says_what_it_was_what_to_do_and_what_becomes_drivable() -> None:
    assert turned([SetWord("water", 1.0)], {"water": -1.0}, {}, {}) == (
        "water was -1: repeat it to turn it, then water becomes drivable; nothing was sent"
    )
    box = (0.1, 0.1, 0.5, 0.5)
    both: list[Operation] = [
        Tap(NO_FRAME, NO_BOX, "grass", -1.0),
        Tap(3, box, "mud", 0.5),
        ForgetWord("bush"),
    ]
    assert turned(both, {"grass": 1.0, "bush": -1.0}, {"mud": -0.5}, {}) == (
        "grass was 1, mud was -0.5: repeat it to turn them, "
        "then grass becomes not drivable, mud becomes drivable; nothing was sent"
    )


def test_refusing_a_place_asks_about_the_words_that_the_match_turned() -> None:
    in_force = {"water": 1.0, "grass": 1.0, "sand": 1.0}
    matched = {"water": (-1.0, 1.0), "grass": (0.5, 1.0), "sand": (None, 1.0), "mud": (-1.0, None)}
    asked = turned([OtherPlace(7)], in_force, {"mud": -1.0}, matched)
    assert asked.startswith("water was 1: repeat it to turn it, then water becomes not drivable;")
    assert turned([OtherPlace(0)], in_force, {}, {}) == ""
