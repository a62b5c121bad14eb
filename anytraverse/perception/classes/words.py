"""Looks up which class of a network a word means: by the names of the classes, and their synonyms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

from anytraverse.errors import BundleError, PreferencesError, UnknownWordError
from anytraverse.preferences import clean_word


@dataclass(frozen=True)
class NamedClass:
    """Holds a class of a network and its synonyms. is_word: whether it may be asked for."""

    name: str
    synonyms: tuple[str, ...] = ()
    is_word: bool = True

    @property
    def spellings(self) -> tuple[str, ...]:
        """All words for it, its name first."""
        return (self.name, *self.synonyms)


class ClassWords:
    """Maps words to classes. `classes` has the order of the network's outputs."""

    def __init__(self, classes: Sequence[NamedClass]) -> None:
        """Raises BundleError for a word that is not allowed or names two classes, and when none is a word."""
        self.classes = tuple(classes)
        self._index: dict[str, int] = {}
        for index, each in enumerate(self.classes):
            for word in each.spellings:
                self._add(word, index)
        if not self.names:
            raise BundleError("no class is a word: at least one must be")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the classes that may be asked for."""
        return tuple(each.name for each in self.classes if each.is_word)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """All words that may be asked for, names first."""
        return (*self.names, *(word for each in self.classes if each.is_word for word in each.synonyms))

    def index(self, word: str) -> int:
        """Return the index of the class that `word` means. Raises UnknownWordError, nearest classes first."""
        word = clean_word(word)
        index = self._index.get(word)
        if index is None or not self.classes[index].is_word:
            raise UnknownWordError(word, self._nearest_first(word))
        return index

    def _add(self, word: str, index: int) -> None:
        try:
            clean = clean_word(word)
        except PreferencesError as error:
            raise BundleError(f"class {index}: {error}") from None
        if clean != word:
            raise BundleError(f'class {index}: write "{word}" as "{clean}"')
        if word in self._index:
            other = self.classes[self._index[word]].name
            raise BundleError(f'"{word}" stands twice, for class {self._index[word]} ("{other}") and {index}')
        self._index[word] = index

    def _nearest_first(self, word: str) -> tuple[str, ...]:
        def distance(each: NamedClass) -> float:
            return -max(SequenceMatcher(None, word, known).ratio() for known in each.spellings)

        return tuple(each.name for each in sorted(self.classes, key=distance) if each.is_word)
