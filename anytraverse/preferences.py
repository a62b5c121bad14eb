"""Holds the operator's words and their weights: tau = {(pi_n, w_n)} of the paper."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from anytraverse.errors import PreferencesError

MAX_WORDS = 16
MAX_WORD_LENGTH = 48
_LONGEST_RAW = 16 * MAX_WORD_LENGTH
_RESERVED = ":;"


@dataclass(frozen=True)
class Setting:
    """Holds a weight in [-1, 1] and the stamp of its setting.

    Stamps count up (a logical clock), so that their order is right on a computer without a real-time clock.
    """

    weight: float
    order: int = 0


def clean_word(word: str) -> str:
    """Return `word` as it is stored: lower case, single spaces, composed accents (NFC).

    Raises PreferencesError when it is empty, longer than 48 characters, not printable or holds ':' or ';'.
    """
    if len(word) > _LONGEST_RAW:  # first: normalizing takes time by the square of its accents
        raise PreferencesError(f"a word has {len(word)} characters: {MAX_WORD_LENGTH} at most")
    cleaned = unicodedata.normalize("NFC", " ".join(word.split()).lower())
    if not cleaned.isprintable():
        raise PreferencesError(f"{word!r} holds characters that cannot be printed: use letters and spaces")
    if not cleaned:
        raise PreferencesError("a word is empty: write it as `grass: 1`")
    if len(cleaned) > MAX_WORD_LENGTH:
        raise PreferencesError(
            f'"{cleaned[:20]}..." has {len(cleaned)} characters: {MAX_WORD_LENGTH} at most'
        )
    if any(mark in cleaned for mark in _RESERVED):
        raise PreferencesError(f'"{cleaned}" holds ":" or ";", which separate words: leave them out')
    return cleaned


def check_weight(word: str, weight: float) -> float:
    """Return `weight` as a float. Raises PreferencesError outside [-1, 1]."""
    weight = float(weight)
    if not math.isfinite(weight) or not -1.0 <= weight <= 1.0:
        raise PreferencesError(f'weight {weight:g} of "{word}" is not in -1 (never drive) to 1 (drive)')
    return weight + 0.0  # -0.0 becomes 0.0


def turns_sign(was: float, now: float) -> bool:
    """Return whether a word of weight `was` and then `now` becomes drivable or not: at 0 it is not."""
    return (was > 0) != (now > 0)


class Preferences(Mapping[str, float]):
    """Maps words to weights, immutably, in the order of first setting, at most 16 words.

    Each word carries the stamp of its setting; stamp 0 means configured.
    """

    def __init__(self, settings: Mapping[str, Setting] | None = None) -> None:
        cleaned: dict[str, Setting] = {}
        for raw, setting in (settings or {}).items():
            word = clean_word(raw)
            if word in cleaned:
                raise PreferencesError(f'"{word}" stands twice: keep one')
            cleaned[word] = Setting(check_weight(word, setting.weight), setting.order)
        if len(cleaned) > MAX_WORDS:
            raise PreferencesError(f"{len(cleaned)} words: {MAX_WORDS} at most can be in use")
        self._settings = cleaned

    @classmethod
    def of(cls, weights: Mapping[str, float], order: int = 0) -> Preferences:
        """Make preferences from word -> weight, all with one stamp. Raises PreferencesError."""
        return cls({word: Setting(weight, order) for word, weight in weights.items()})

    @classmethod
    def parse(cls, text: str, order: int = 0) -> Preferences:
        """Read `grass: 1; rock: -0.8` (a trailing `;` is allowed). Raises PreferencesError."""
        settings: dict[str, Setting] = {}
        parts = text.split(";")
        if parts and not parts[-1].strip():
            parts.pop()
        for part in parts:
            raw, colon, number = part.rpartition(":")
            if not colon:
                raise PreferencesError(
                    f'"{part.strip()}" has no weight: write it as `word: weight`, e.g. `grass: 1`'
                )
            word = clean_word(raw)
            try:
                weight = float(number)
            except ValueError:
                raise PreferencesError(
                    f'"{number.strip()}" is not a weight for "{word}": give a number from -1 to 1'
                ) from None
            if word in settings:
                raise PreferencesError(f'"{word}" stands twice: keep one')
            settings[word] = Setting(check_weight(word, weight), order)
        return cls(settings)

    def format(self) -> str:
        """Return the text that `parse` reads, with weights exact to the last digit."""
        return "; ".join(f"{word}: {str(weight).removesuffix('.0')}" for word, weight in self.items())

    def __getitem__(self, word: str) -> float:
        return self._settings[word].weight

    def __iter__(self) -> Iterator[str]:
        return iter(self._settings)

    def __len__(self) -> int:
        return len(self._settings)

    def __eq__(self, other: object) -> bool:
        """Compare words and weights; neither stamps nor the order of words count."""
        return dict(self) == dict(other) if isinstance(other, Preferences) else NotImplemented

    def __hash__(self) -> int:
        return hash(frozenset(self.items()))

    def __repr__(self) -> str:
        return f"Preferences({self.format()!r})"

    @property
    def settings(self) -> Mapping[str, Setting]:
        """Word -> weight and stamp."""
        return dict(self._settings)

    def order(self, word: str) -> int:
        """Return the stamp of the word's setting. Raises KeyError."""
        return self._settings[word].order

    def merged(self, newer: Preferences) -> Preferences:
        """Return nu(tau, newer) of the paper: the words of `newer` win, the others stay in their places.

        Beyond 16 words the least recently set are dropped; of equal stamps, those that are not in `newer`.
        """
        settings = {**self._settings, **newer._settings}
        oldest_first = sorted(settings, key=lambda word: (settings[word].order, word in newer))
        for word in oldest_first[: max(0, len(settings) - MAX_WORDS)]:
            del settings[word]
        return Preferences(settings)

    def without(self, *words: str) -> Preferences:
        """Return these preferences without some words; a word that is not in use is no error."""
        gone = {clean_word(word) for word in words}
        return Preferences({word: setting for word, setting in self._settings.items() if word not in gone})
