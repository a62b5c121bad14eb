"""Finds words of one meaning that have weights of opposite signs."""

from __future__ import annotations

from collections.abc import Callable

from anytraverse.errors import PreferencesError
from anytraverse.preferences import Preferences

Meaning = Callable[[str], str]
"""`Perceiver.meaning`: a word -> the name that it shares with its synonyms. Raises UnknownWordError."""


def meaning_of(word: str, meaning: Meaning) -> str | None:
    """Return the word's meaning; None where the perceiver cannot ground it (it may have tapped examples)."""
    try:
        return meaning(word)
    except PreferencesError:
        return None


def opposed(word: str, weight: float, preferences: Preferences, meaning: Meaning) -> list[str]:
    """Return the other words of `preferences` that mean the same as `word`, with the opposite sign."""
    own = meaning_of(word, meaning)
    if own is None:
        return []
    return [
        other
        for other, theirs in preferences.items()
        if other != word and weight * theirs < 0 and meaning_of(other, meaning) == own
    ]


def refuse_contradictions(preferences: Preferences, meaning: Meaning) -> None:
    """Raise PreferencesError when two words of one meaning have opposite signs."""
    for word, weight in preferences.items():
        for other in opposed(word, weight, preferences, meaning):
            older, newer = sorted((other, word), key=preferences.order)
            raise PreferencesError(
                f'"{newer}: {preferences[newer]:g}" contradicts "{older}: {preferences[older]:g}", '
                f'which means the same: change or forget "{older}"'
            )
