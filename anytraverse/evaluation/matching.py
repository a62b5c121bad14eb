"""Finds the label classes that a word stands for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from anytraverse.errors import PreferencesError
from anytraverse.evaluation.labels import DatasetError, LabelClasses, fold
from anytraverse.preferences import clean_word
from anytraverse.synonyms import Meaning, meaning_of

Matches = Mapping[str, tuple[str, ...]]
"""Word -> its classes; empty for a word that no class matches."""


def parse_matches(text: str) -> dict[str, tuple[str, ...]]:
    """Read `trail=smooth_trail,trail=rough_trail`: a word may stand for several classes.

    Raises DatasetError, PreferencesError.
    """
    matches: dict[str, tuple[str, ...]] = {}
    for part in filter(str.strip, text.split(",")):
        raw, sign, name = part.partition("=")
        if not sign or not name.strip():
            raise DatasetError(f'"{part.strip()}" matches nothing: write word=class, e.g. trail=smooth_trail')
        word = clean_word(raw)
        matches[word] = (*matches.get(word, ()), name)
    return matches


def match_words(words: Iterable[str], classes: LabelClasses, meaning: Meaning, given: Matches) -> Matches:
    """Find the classes of each word: the given ones, or else those of the same name or meaning.

    A word without such a class gets the classes whose last part means the same ("trail" gets "smooth_trail"),
    unless another word has them. Raises DatasetError for a match of a word that is not in `words`, or with a
    class that does not exist.
    """
    asked = tuple(words)
    for word in given:
        if word not in asked:
            raise DatasetError(f'"{word}" is matched but not asked: add it to the prompts, or leave it out')
    names = tuple(classes.known.values())
    found = {
        word: classes.choose(given[word]) if word in given else _of_one_meaning(word, names, meaning)
        for word in asked
    }
    kinds = {name: fold(name).split()[-1] for name in names if " " in fold(name)}
    free = [name for name in kinds if not any(name in taken for taken in found.values())]
    return {
        word: taken if taken or word in given else tuple(n for n in free if _same(word, kinds[n], meaning))
        for word, taken in found.items()
    }


def refuse_asked(words: Iterable[str], unknown: Iterable[str], meaning: Meaning) -> None:
    """Raise PreferencesError when a word names a class that is to be unknown."""
    for name, word in asked_names(words, unknown, meaning).items():
        raise PreferencesError(
            f'"{word}" asks for "{name}", which shall be unknown: what is asked for is known. '
            f'Leave the word out of the prompts, or "{name}" out of --unknown'
        )


def asked_names(words: Iterable[str], names: Iterable[str], meaning: Meaning) -> dict[str, str]:
    """Return those of the names that a word asks for, by name or by meaning, with the word."""
    every = tuple(names)
    return {name: word for word in words for name in _of_one_meaning(word, every, meaning)}


def _of_one_meaning(word: str, names: Iterable[str], meaning: Meaning) -> tuple[str, ...]:
    """Return the names that have the spelling or the meaning of the word."""
    return tuple(name for name in names if _same(word, name, meaning))


def _same(word: str, name: str, meaning: Meaning) -> bool:
    own = meaning_of(word, meaning)
    return fold(name) == fold(word) or (own is not None and meaning_of(fold(name), meaning) == own)
