"""Perceives the simulated field without an error: what limits the distance of a call then is the region."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.regions import Box
from companion.sim.field.render import GROUND_KINDS, LABELS
from companion.sim.field.things import DEFAULT_SURPRISES

Maps = NDArray[np.float32]
_CELLS = (64, 48)
"""Columns and rows of a map, as of the built-in perceiver."""
_WORDS = tuple(name for name in LABELS if name not in DEFAULT_SURPRISES)


class TruePerceiver:
    """Makes attention maps of the true labels, as fine as those of the built-in perceiver: see `show`.

    A word has the share of a cell that its label covers. Of the words of one side, drivable or not, the
    strongest has what all of them cover: a border of two grounds is known. Every place looks the same to it.
    """

    model_id = "truth"
    vocabulary: tuple[str, ...] | None = _WORDS
    defaults = DefaultThresholds(roi=0.4, scene=0.9, tile=0.6)
    """Of maps and tiles those of the built-in perceiver."""
    independent = True

    def __init__(self) -> None:
        self._labels: NDArray[np.uint8] | None = None

    def show(self, labels: NDArray[np.uint8]) -> None:
        """Take in the labels of the next picture, (H, W), indices into `LABELS`."""
        self._labels = labels

    def meaning(self, word: str) -> str:
        """Return the word itself. Raises UnknownWordError for one that is no label."""
        if word not in _WORDS:
            raise UnknownWordError(word, _WORDS)
        return word

    def encode(self, image: Image) -> dict[str, Maps]:
        """Return the map of each word for the labels that were shown, by word."""
        if self._labels is None or self._labels.shape != image.shape[:2]:
            raise ValueError("the labels are of another picture: show them first")
        found = {word: _shares(self._labels, word) for word in _WORDS}
        for drivable in (True, False):
            side = [word for word in found if (word in GROUND_KINDS) is drivable]
            shares = np.stack([found[word] for word in side])
            strongest, whole = shares.argmax(axis=0), shares.sum(axis=0)
            for number, word in enumerate(side):
                found[word] = np.where(strongest == number, whole, 0.0).astype(np.float32)
        return found

    def attend(self, features: dict[str, Maps], prompts: Sequence[Prompt]) -> Maps:
        """Return the maps of the words. Raises UnknownWordError."""
        return np.array([features[self.meaning(prompt.word)] for prompt in prompts], np.float32)

    def embed(self, features: dict[str, Maps]) -> Maps:  # noqa: ARG002
        """Return the same vector for every place."""
        return np.array([1.0], np.float32)

    def example(self, features: dict[str, Maps], box: Box) -> Example:  # noqa: ARG002
        """Learn nothing. Raises ExampleError."""
        raise ExampleError("the truth learns no examples")


def _shares(labels: NDArray[np.uint8], word: str) -> Maps:
    shown = np.asarray(labels == LABELS.index(word), np.float32)
    return np.asarray(cv2.resize(shown, _CELLS, interpolation=cv2.INTER_AREA), np.float32)
