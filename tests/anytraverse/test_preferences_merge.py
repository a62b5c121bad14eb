"""nu(tau1, tau2): tau2 wins, the rest of tau1 stays."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import PreferencesError
from anytraverse.preferences import MAX_WORDS, Preferences, Setting

names = st.sampled_from([f"word {n}" for n in range(24)])


def preferences(lowest: int, highest: int) -> st.SearchStrategy[Preferences]:
    """Words with stamps from `lowest` to `highest`."""
    setting = st.builds(Setting, st.floats(-1, 1), st.integers(lowest, highest))
    return st.dictionaries(names, setting, max_size=MAX_WORDS).map(Preferences)


@given(preferences(0, 9), preferences(9, 12))
@settings(max_examples=150)
def test_newer_words_win_the_rest_stays_and_the_oldest_go(older: Preferences, newer: Preferences) -> None:
    merged = older.merged(newer)
    assert {word: merged.settings[word] for word in newer} == newer.settings
    rest = {word: setting for word, setting in older.settings.items() if word not in newer}
    stayed = {word: setting for word, setting in merged.settings.items() if word not in newer}
    assert stayed.items() <= rest.items()
    assert len(merged) == min(MAX_WORDS, len(rest) + len(newer))
    gone = rest.keys() - stayed.keys()
    assert all(rest[lost].order <= rest[kept].order for lost in gone for kept in stayed)


@given(preferences(0, 9), preferences(0, 9))
@settings(max_examples=100)
def test_the_most_recent_stamps_stay_whoever_brings_them(one: Preferences, other: Preferences) -> None:
    merged = one.merged(other)
    candidates = {**one.settings, **other.settings}
    gone = candidates.keys() - merged.keys()
    assert len(merged) == min(MAX_WORDS, len(candidates))
    assert all(candidates[lost].order <= merged.order(kept) for lost in gone for kept in merged)


def test_a_word_keeps_its_place_when_its_weight_changes() -> None:
    merged = Preferences.parse("grass: 1; rock: -1").merged(Preferences.parse("grass: 0.5", order=4))
    assert merged.format() == "grass: 0.5; rock: -1"
    assert merged.order("grass") == 4
    assert merged.order("rock") == 0


def test_merging_changes_neither_side() -> None:
    one, other = Preferences.parse("grass: 1"), Preferences.parse("grass: -1; rock: -1")
    one.merged(other)
    assert one.format() == "grass: 1"
    assert other.format() == "grass: -1; rock: -1"


def test_sixteen_new_words_at_once_replace_all_old_ones() -> None:
    old = Preferences.of({f"old {n}": 1 for n in range(MAX_WORDS)}, order=1)
    new = Preferences.of({f"new {n}": -1 for n in range(MAX_WORDS)}, order=2)
    assert old.merged(new) == new


def test_seventeen_words_at_once_are_refused() -> None:
    with pytest.raises(PreferencesError, match="17 words"):
        Preferences.of({f"new {n}": -1 for n in range(MAX_WORDS + 1)})


def test_of_equal_stamps_the_words_that_were_there_before_go() -> None:
    old = Preferences.of({f"old {n}": 1 for n in range(MAX_WORDS)})
    merged = old.merged(Preferences.of({"old 0": -1, "new": 1}))
    assert merged["old 0"] == -1
    assert "new" in merged
    assert "old 1" not in merged


def test_words_are_taken_away_under_any_spelling() -> None:
    assert Preferences.parse("grass: 1; rock: -1").without(" GRASS", "mud") == Preferences.parse("rock: -1")
