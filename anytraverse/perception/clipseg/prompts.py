"""Turns words into conditions with the text tower, which is loaded for new words and released afterwards."""

from __future__ import annotations

import ctypes
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import BundleError, PerceiverError
from anytraverse.perception.clipseg.tokenizer import Tokenizer
from anytraverse.perception.runtime import Runtime, open_session, run_session

Array = NDArray[np.float32]

_CACHE_SIZE = 256


class Prompts:
    """Computes the conditions of words, (joint,) each, and caches those of the last 256 words used."""

    def __init__(self, text: Sequence[Path], tokenizer: Path, table: Path, runtime: Runtime) -> None:
        """text: the pieces of the tower, in order. tokenizer, table: the bundle's other files.

        Raises BundleError for an unusable table, PerceiverError for an unusable tokenizer.
        """
        self._text = tuple(text)
        self._tokenizer = Tokenizer.load(tokenizer)
        self._runtime = runtime
        try:
            self._table: Array = np.lib.format.open_memmap(table, mode="r")
        except (OSError, ValueError) as error:
            raise BundleError(f"{table} cannot be read ({error}): copy the bundle again") from error
        if self._table.ndim != 2 or self._table.dtype != np.float32:
            raise BundleError(f"{table} is no table of tokens: export the bundle again")
        self._cache: OrderedDict[str, Array] = OrderedDict()

    def conditions(self, words: Sequence[str]) -> list[Array]:
        """Return a condition for each word, in order. Raises PerceiverError and BundleError."""
        missing = [word for word in dict.fromkeys(words) if word not in self._cache]
        if missing:
            self._embed(missing)
        for word in words:
            self._cache.move_to_end(word)
        found = [self._cache[word] for word in words]
        while len(self._cache) > _CACHE_SIZE:
            self._cache.popitem(last=False)
        return found

    def _embed(self, words: Sequence[str]) -> None:
        states = [np.asarray(self._table[self._ids(word)]) for word in words]
        for piece in self._text:
            session = open_session(piece, self._runtime)
            states = [run_session(session, {"tokens": state})[0] for state in states]
            del session
            _give_back_memory()
        for word, condition in zip(words, states, strict=True):
            if not np.isfinite(condition).all():
                raise PerceiverError(f'the text network gave no finite answer for "{word}": check the bundle')
            self._cache[word] = condition

    def _ids(self, word: str) -> list[int]:
        """Return the token ids up to the first end of text: the text tower is read at that token."""
        ids = self._tokenizer.encode(word)
        ids = ids[: ids.index(self._tokenizer.end) + 1]
        if max(ids) >= len(self._table):
            raise BundleError("the tokenizer knows more tokens than the network: export the bundle again")
        return ids


def _give_back_memory() -> None:
    """Return freed memory to the system: glibc would keep the 25 MB of each piece of the text tower."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
