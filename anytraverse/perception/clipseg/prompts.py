"""Turns words into conditions for the decoder."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.runtime import Runtime
from anytraverse.perception.text_tower import TextTower
from anytraverse.perception.tokenizer import Tokenizer

Array = NDArray[np.float32]

_CACHE_SIZE = 256


class Prompts:
    """Computes the conditions of words, (joint,) each, and caches those of the last 256 words used."""

    def __init__(self, text: Sequence[Path], tokenizer: Path, table: Path, runtime: Runtime) -> None:
        """text: the pieces of the tower, in order. tokenizer, table: the bundle's other files.

        Raises BundleError for an unusable table, PerceiverError for an unusable tokenizer, and without the
        package `tokenizers`.
        """
        self._tokenizer = Tokenizer.load(tokenizer)
        self._tower = TextTower(text, table, runtime)
        self._cache: OrderedDict[str, Array] = OrderedDict()

    def conditions(self, words: Sequence[str]) -> list[Array]:
        """Return a condition for each word, in order. Raises PerceiverError and BundleError."""
        missing = [word for word in dict.fromkeys(words) if word not in self._cache]
        if missing:
            self._cache.update(self._tower.embed({word: self._ids(word) for word in missing}))
        for word in words:
            self._cache.move_to_end(word)
        found = [self._cache[word] for word in words]
        while len(self._cache) > _CACHE_SIZE:
            self._cache.popitem(last=False)
        return found

    def _ids(self, word: str) -> list[int]:
        """Return the token ids up to the first end of text: the text tower is read at that token."""
        ids = self._tokenizer.encode(word)
        return ids[: ids.index(ids[-1]) + 1] if ids else ids
