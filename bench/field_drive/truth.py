"""Perceives the simulated field without an error, and knows a word for each thing in it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import Prompt
from companion.desk.exchange.truth import TruePerceiver
from companion.sim.field.render import LABELS
from companion.sim.field.things import DEFAULT_SURPRISES

Maps = NDArray[np.float32]


class NamingPerceiver(TruePerceiver):
    """Knows drums, rocks and logs as well, once they have been named: an operator who answers needs that."""

    vocabulary: tuple[str, ...] | None = LABELS

    def __init__(self) -> None:
        super().__init__()
        self._shown: NDArray[np.uint8] | None = None

    def show(self, labels: NDArray[np.uint8]) -> None:
        """As of `TruePerceiver`."""
        super().show(labels)
        self._shown = labels

    def meaning(self, word: str) -> str:
        """Return the word itself. Raises UnknownWordError for one that is no label."""
        if word not in LABELS:
            raise UnknownWordError(word, LABELS)
        return word

    def encode(self, image: Image) -> dict[str, Maps]:
        """Return the map of each word: of a thing the share of a cell that it covers."""
        found, labels = super().encode(image), self._shown
        assert labels is not None
        rows, columns = found[LABELS[0]].shape
        for word in DEFAULT_SURPRISES:
            covers = np.asarray(labels == LABELS.index(word), np.float32)
            found[word] = np.asarray(cv2.resize(covers, (columns, rows), interpolation=cv2.INTER_AREA))
        return found

    def attend(self, features: dict[str, Maps], prompts: Sequence[Prompt]) -> Maps:
        """Return the maps of the words. Raises UnknownWordError."""
        return np.array([features[self.meaning(prompt.word)] for prompt in prompts], np.float32)
