"""Runs a text encoder, whose pieces are loaded for new texts one after the other and released afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import BundleError, PerceiverError
from anytraverse.perception.runtime import Runtime, give_back_memory, open_session, run_session

Array = NDArray[np.float32]


class TextTower:
    """Turns token ids into vectors."""

    def __init__(self, pieces: Sequence[Path], table: Path, runtime: Runtime) -> None:
        """pieces: the networks of the tower, in order. table: the tokens' vectors, (tokens, width) float32.

        Raises BundleError for an unusable table.
        """
        self._pieces = tuple(pieces)
        self._runtime = runtime
        self._table: Array = open_array(table)
        if self._table.ndim != 2 or self._table.dtype != np.float32:
            raise BundleError(f"{table} is no table of tokens: export the bundle again")

    def embed(self, texts: Mapping[str, Sequence[int]]) -> dict[str, Array]:
        """Return text -> vector from text -> its token ids. Raises PerceiverError and BundleError."""
        if any(max(ids, default=-1) >= len(self._table) for ids in texts.values()):
            raise BundleError("the tokenizer knows more tokens than the network: export the bundle again")
        states = [np.asarray(self._table[list(ids)]) for ids in texts.values()]
        for piece in self._pieces:
            session = open_session(piece, self._runtime, once=True)
            for index, state in enumerate(states):
                self._runtime.progress()
                states[index] = run_session(session, {"tokens": state})[0]
            del session
            give_back_memory()
        made = dict(zip(texts, states, strict=True))
        if any(state.ndim != 1 or state.shape != states[0].shape for state in states):
            raise BundleError("the text network gives no embedding for a text: export the bundle again")
        for text, state in made.items():
            if not np.isfinite(state).all():
                raise PerceiverError(f'the text network gave no finite answer for "{text}": check the bundle')
        return made


def open_array(path: Path) -> NDArray[Any]:
    """Map a .npy file into memory, read-only, so that its header cannot demand memory. Raises BundleError."""
    try:
        return np.lib.format.open_memmap(path, mode="r")
    except Exception as error:  # numpy, tokenize and mmap raise many classes for a bad header
        why = " ".join(str(error).split())[:200]
        raise BundleError(f"{path} cannot be read ({why}): copy the bundle again") from error
