"""Turns words into directions in the space of the patches."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.perception.dense.details import filled
from anytraverse.perception.runtime import give_back_memory
from anytraverse.perception.text_tower import TextTower
from anytraverse.perception.tokenizer import Tokenizer

Array = NDArray[np.float32]

_CACHE_SIZE = 256


class WordEmbeddings:
    """Looks up or computes the embeddings of words, unit vectors (d,); caches the last 256 computed.

    A word's embedding is the mean of the unit vectors of all templates with the word, scaled to length 1.
    """

    def __init__(
        self,
        tower: TextTower,
        tokenizer: Path,
        templates: Sequence[str],
        known: Mapping[str, Array] | None = None,
    ) -> None:
        """tokenizer: its file; 256,000 tokens take 300 MB, so it is read for new words and released.

        known: embeddings of words that need not be computed.
        Raises PerceiverError for an unusable tokenizer, and without the package `tokenizers`.
        """
        Tokenizer.load(tokenizer)  # else what is wrong would show at the first new word, on the way
        give_back_memory()
        self._known = dict(known or {})
        self._tower = tower
        self._tokenizer = tokenizer
        self._templates = tuple(templates)
        self._cache: OrderedDict[str, Array] = OrderedDict()

    def embeddings(self, words: Sequence[str]) -> list[Array]:
        """Return the embedding of each word, in order. Raises PerceiverError and BundleError."""
        asked = [word for word in words if word not in self._known]
        missing = [word for word in dict.fromkeys(asked) if word not in self._cache]
        if missing:
            self._embed(missing)
        for word in asked:
            self._cache.move_to_end(word)
        found = [self._known[word] if word in self._known else self._cache[word] for word in words]
        while len(self._cache) > _CACHE_SIZE:
            self._cache.popitem(last=False)
        return found

    def _embed(self, words: Sequence[str]) -> None:
        texts = {word: [filled(template, word) for template in self._templates] for word in words}
        tokenizer = Tokenizer.load(self._tokenizer)
        ids = {text: tokenizer.encode(text) for each in texts.values() for text in each}
        del tokenizer
        give_back_memory()
        vectors = self._tower.embed(ids)
        for word, each in texts.items():
            mean = np.mean([unit(vectors[text]) for text in each], axis=0)
            self._cache[word] = unit(np.asarray(mean, dtype=np.float32))


def unit(vectors: Array) -> Array:
    """Scale vectors, (..., d), to length 1. Raises PerceiverError for 0 and for what is not finite."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not np.isfinite(lengths).all() or not lengths.all():
        raise PerceiverError("the network's output is empty or not finite")
    return np.asarray(vectors / lengths, dtype=np.float32)
