"""A perceiver without a network: a lexicon of ground words, known by colour, light, roughness and height.

It needs a few milliseconds a frame and OpenCV alone. Grass, paths, vegetation and sky are its strong words;
water, rock and log are weak: tap such things rather than naming them. Places are told apart only by the
colour and roughness of their ground.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import UnknownWordError
from anytraverse.frame import Image, check_image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.ground_features import Grid, ground_features
from anytraverse.perception.lexicon_words import LOOKS, TRUST, VOCABULARY, meaning
from anytraverse.perception.looks import Look, attention
from anytraverse.perception.scene import SAME_PLACE, scene_vector
from anytraverse.perception.tapped import learn_look, look_of, vector_of
from anytraverse.regions import Box

MODEL_ID = "builtin-lexicon-1"


class Lexicon:
    """A `Perceiver` that knows some forty words. Stateless: its features are the grid of measurements."""

    model_id = MODEL_ID
    vocabulary = VOCABULARY
    defaults = DefaultThresholds(roi=0.3, scene=SAME_PLACE, tile=0.25)

    def meaning(self, word: str) -> str:
        """The concept under which synonyms meet. Raises UnknownWordError."""
        return meaning(word)

    def trust(self, word: str) -> str:
        """How far the word can be trusted, "good" or "weak". Raises UnknownWordError."""
        return TRUST.get(meaning(word), "good")

    def encode(self, image: Image) -> Grid:
        """The measurements of an RGB frame: see `ground_features`."""
        check_image(image)
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
        return look_of(example.vector_for(self.model_id))
