"""Makes frames and a perceiver that reads them: a picture shows one thing by its number; 0 is grass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.regions import Box

GRASS = "grass"
_HEIGHT, _WIDTH = 20, 30


def thing(number: int) -> str:
    """Returns the word for what a picture of `number` shows."""
    return f"thing {number}" if number else GRASS


def picture(number: int) -> Image:
    """Makes a picture of thing `number`, 0 to 65535."""
    image = np.empty((_HEIGHT, _WIDTH, 3), dtype=np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = number >> 8, number & 0xFF, 200
    return image


class NumberPerceiver:
    """A perceiver that reads the number off the picture, and takes every picture for the same place."""

    model_id = "plates-1"
    vocabulary: tuple[str, ...] | None = None
    defaults = DefaultThresholds(roi=0.3, scene=0.85)

    def meaning(self, word: str) -> str:
        """Returns the word: every word has a meaning of its own."""
        return word

    def encode(self, image: Image) -> Image:
        """Returns the picture itself."""
        return image

    def attend(self, features: Image, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """Returns 1 everywhere for the word of the picture's thing, 0 for others."""
        shown = thing(int(features[0, 0, 0]) << 8 | int(features[0, 0, 1]))
        maps = np.zeros((len(prompts), _HEIGHT // 2, _WIDTH // 2), dtype=np.float32)
        for index, prompt in enumerate(prompts):
            maps[index] = prompt.word == shown
        return maps

    def embed(self, features: Image) -> NDArray[np.float32]:  # noqa: ARG002
        """Returns the embedding of the one place."""
        return np.array([1.0, 0.0], dtype=np.float32)

    def example(self, features: Image, box: Box) -> Example:  # noqa: ARG002
        """Returns the thing's number."""
        return Example(self.model_id, np.array([features[0, 0, 0], features[0, 0, 1]], dtype=np.float32))
