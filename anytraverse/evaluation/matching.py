"""Finds the label classes that a word stands for."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from anytraverse.errors import PreferencesError
from anytraverse.evaluation.labels import DatasetError, LabelClasses, fold
from anytraverse.preferences import clean_word
from anytraverse.synonyms import Meaning, meaning_of

Matches = Mapping[str, tuple[str, ...]]
"""Word -> its classes; empty for a word that no class matches."""
GIVEN, NAMED, KIND, USUAL, NONE = "given", "name", "kind", "usual", "none"
"""How a word came to its classes."""
_ALTERNATIVES = re.compile(r"[/,;|()]|\bor\b")


class WordMatch(NamedTuple):
    """Holds the classes of a word, and how it came to them."""

    classes: tuple[str, ...]
    how: str


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


def match_words(
    words: Iterable[str], classes: LabelClasses, meaning: Meaning, given: Matches, usual: Matches
) -> dict[str, WordMatch]:
    """Find the classes of each word: the given ones, or else those of the same name or meaning.

    A word without such a class gets the classes whose last part means the same ("trail" gets "smooth_trail"),
    or else those that `usual` has for it ("bush": "low vegetation"), unless another word has them. usual:
    word -> names of classes, of which a data set may have some. Raises DatasetError for a match of a word
    that is not in `words`, or with a class that does not exist.
    """
    asked = tuple(words)
    for word in given:
        if word not in asked:
            raise DatasetError(f'"{word}" is matched but not asked: add it to the prompts, or leave it out')
    names = tuple(classes.known.values())
    kinds = {name: fold(name).split()[-1] for name in names if " " in fold(name)}
    found = {word: WordMatch(classes.choose(given[word]), GIVEN) for word in asked if word in given}

    def take(word: str, taken: Iterable[str], how: str) -> None:
        if word not in found and (own := tuple(taken)):
            found[word] = WordMatch(own, how)

    def free() -> list[str]:
        return [name for name in names if not any(name in one.classes for one in found.values())]

    for word in asked:
        take(word, _of_one_meaning(word, names, meaning), NAMED)
    left = [name for name in free() if name in kinds]
    for word in asked:
        take(word, (name for name in left if _same(word, kinds[name], meaning)), KIND)
    left = free()
    for word in asked:
        own = {fold(name) for key, listed in usual.items() if _same(word, key, meaning) for name in listed}
        take(word, (name for name in left if fold(name) in own), USUAL)
    return {word: found.get(word, WordMatch((), NONE)) for word in asked}


def told(matches: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what each word was matched with, for a person, and the option that says otherwise.

    matches: word -> "classes" and "how", as in `WordMatch`.
    """
    said = [f"{word} = {', '.join(one['classes']) or 'no class'}" for word, one in matches.items()]
    usual = [
        f"{word}={name}" for word, one in matches.items() if one["how"] == USUAL for name in one["classes"]
    ]
    more = f' (taken as --match "{",".join(usual)}": give another to change it)' if usual else ""
    return "; ".join(said) + more


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
    """Return the names that have the spelling or the meaning of the word, or one of whose parts has it."""
    return tuple(name for name in names if any(_same(word, one, meaning) for one in _parts(name)))


def _parts(name: str) -> list[str]:
    """Return a class's name and what it is put together of: "bush/shrub" is a bush, or a shrub."""
    return list(dict.fromkeys([name, *filter(str.strip, _ALTERNATIVES.split(name))]))


def _same(word: str, name: str, meaning: Meaning) -> bool:
    one, other = fold(word), fold(name)
    if one == other or _plural(one, other) or _plural(other, one):
        return True
    own = meaning_of(word, meaning)
    return own is not None and meaning_of(other, meaning) == own


def _plural(one: str, many: str) -> bool:
    return many in (f"{one}s", f"{one}es")
