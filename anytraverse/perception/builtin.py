"""The built-in perceiver: a lexicon of ground words over colour, light, roughness and height in the image.

It needs no download and a few milliseconds a frame. Grass, paths, vegetation and sky are its strong words;
water, rock and log are weak: tap such things rather than naming them. Places are told apart only by
the colour and roughness of their ground.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, PerceiverError, UnknownWordError
from anytraverse.frame import Image, is_image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.ground_features import Grid, ground_features
from anytraverse.perception.lexicon import LOOKS, VOCABULARY, meaning
from anytraverse.perception.looks import Look, attention
from anytraverse.perception.runtime import Runtime
from anytraverse.perception.scene import SAME_PLACE, scene_vector
from anytraverse.perception.tapped import learn_look, look_of, vector_of
from anytraverse.preferences import clean_word
from anytraverse.regions import Box

MODEL_ID = "builtin-lexicon-1"


class Builtin:
    """A `Perceiver` that knows some forty words. Stateless: its features are the grid of measurements."""

    model_id = MODEL_ID
    vocabulary = VOCABULARY
    defaults = DefaultThresholds(roi=0.3, scene=SAME_PLACE, tile=0.25)

    def __init__(self, argument: str = "", runtime: Runtime | None = None) -> None:  # noqa: ARG002
        """It runs no network. Raises PerceiverError for an argument: it takes none."""
        if argument:
            raise PerceiverError(
                f'the built-in perceiver takes no argument: write "builtin", not "builtin:{argument}"'
            )

    def meaning(self, word: str) -> str:
        """The concept under which synonyms meet. Raises UnknownWordError."""
        return meaning(clean_word(word))

    def encode(self, image: Image) -> Grid:
        """The measurements of an RGB frame: see `ground_features`."""
        if not is_image(image):
            raise PerceiverError("a frame must be an RGB picture, (height, width, 3) of uint8, not empty")
        return ground_features(image)

    def attend(self, features: Grid, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """Attention maps, (len(prompts), h, w) in [0, 1]. Raises UnknownWordError, ExampleError."""
        return attention(features, [self._looks(prompt) for prompt in prompts])

    def embed(self, features: Grid) -> NDArray[np.float32]:
        """The scene, a unit vector: see `scene_vector`."""
        return scene_vector(features)

    def example(self, features: Grid, box: Box) -> Example:
        """The look of the thing in the box. Raises ExampleError when the box is too small."""
        return Example(self.model_id, vector_of(learn_look(features, box)))

    def _looks(self, prompt: Prompt) -> tuple[Look, ...]:
        """What the prompt looks for: the looks of its word, if it is a known one, and of its examples."""
        try:
            named = LOOKS[self.meaning(prompt.word)]
        except UnknownWordError:
            if not prompt.examples:
                raise
            named = ()
        return (*named, *(self._tapped(example) for example in prompt.examples))

    def _tapped(self, example: Example) -> Look:
        if example.model_id != self.model_id:
            raise ExampleError(
                f"this example was tapped with {example.model_id}, not {self.model_id}: tap the thing again"
            )
        return look_of(example.vector)
