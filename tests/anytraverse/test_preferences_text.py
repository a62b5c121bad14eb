"""Words as a person types them."""

from __future__ import annotations

import contextlib
import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import PreferencesError
from anytraverse.preferences import MAX_WORD_LENGTH, MAX_WORDS, Preferences, check_weight, clean_word

letters = st.characters(categories=["L", "M", "N", "P", "S"], exclude_characters=":;\u037e")
words = st.text(letters, min_size=1, max_size=12).map(clean_word)


@given(st.dictionaries(words, st.floats(-1, 1), max_size=MAX_WORDS))
@settings(max_examples=60)
def test_what_is_formatted_is_parsed_back_to_the_last_digit(chosen: dict[str, float]) -> None:
    preferences = Preferences.of(chosen)
    again = Preferences.parse(preferences.format())
    assert again == preferences
    assert list(again) == list(preferences)


@given(st.text(max_size=80) | st.text(alphabet="ab:;-1.e ", max_size=30))
@settings(max_examples=150)
def test_rubbish_is_refused_by_a_preferences_error_or_understood(text: str) -> None:
    with contextlib.suppress(PreferencesError):
        understood = Preferences.parse(text)
        assert all(-1 <= weight <= 1 and clean_word(word) == word for word, weight in understood.items())


@given(st.text(max_size=60))
@settings(max_examples=150)
def test_a_cleaned_word_is_clean(raw: str) -> None:
    with contextlib.suppress(PreferencesError):
        assert clean_word(clean_word(raw)) == clean_word(raw)


def test_words_are_written_as_a_person_would() -> None:
    assert (
        Preferences.of({"grass": 1, "Tall  Rock": -0.8, "mud": 0}).format()
        == "grass: 1; tall rock: -0.8; mud: 0"
    )


def test_spaces_line_breaks_and_a_trailing_semicolon_do_not_matter() -> None:
    assert dict(Preferences.parse(" Grass:1;\n  dry\tgrass : .5 ; ")) == {"grass": 1, "dry grass": 0.5}
    assert len(Preferences.parse("  ")) == 0


def test_an_accent_has_one_spelling() -> None:
    assert clean_word("Re\u0301gion") == clean_word("r\u00e9gion")


def test_a_negative_zero_is_zero() -> None:
    assert math.copysign(1, check_weight("mud", -0.0)) == 1


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("grass", "has no weight"),
        (";grass: 1", "has no weight"),
        ("grass: green", '"green" is not a weight'),
        ("grass: 1.01", "-1 .* to 1"),
        ("grass: nan", "-1 .* to 1"),
        ("grass: -inf", "-1 .* to 1"),
        ("grass: 1; GRASS: -1", "stands twice"),
        (": 1", "empty"),
        ("a:b: 1", "separate words"),
        ("gr\x00ass: 1", "printed"),
        ("x" * (MAX_WORD_LENGTH + 1) + ": 1", "48 at most"),
        ("; ".join(f"w{n}: 1" for n in range(MAX_WORDS + 1)), "17 words: 16 at most"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(text: str, names: str) -> None:
    with pytest.raises(PreferencesError, match=names):
        Preferences.parse(text)


def test_a_word_of_a_stranger_takes_no_seconds() -> None:
    began = time.thread_time()
    with pytest.raises(PreferencesError, match="48 at most"):
        clean_word("\u0301\u0316" * 62_000)
    assert time.thread_time() - began < 0.5


def test_two_spellings_of_one_word_are_refused() -> None:
    with pytest.raises(PreferencesError, match="stands twice"):
        Preferences.of({"Grass": 1, "grass": -1})


def test_equality_looks_at_words_and_weights_alone() -> None:
    one, other = Preferences.of({"a": 1, "b": 0}, order=3), Preferences.of({"b": 0, "a": 1}, order=7)
    assert one == other
    assert hash(one) == hash(other)
    assert one != Preferences.of({"a": 1})
    assert "a: 1" in repr(one)
