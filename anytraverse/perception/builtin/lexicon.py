"""Perceives ground by the colour and roughness of its words: the perceiver `builtin:lexicon`, no network.

The looks are centres and spreads of the features in features.py. They were fitted to labelled frames of
forest tracks, gravel roads and meadows, then rounded and widened by hand for other cameras.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import UnknownWordError
from anytraverse.frame import Image, check_image
from anytraverse.perception import WEAK, DefaultThresholds, Example, Prompt
from anytraverse.perception.builtin.features import Grid, ground_features
from anytraverse.perception.builtin.lexicon_scene import SAME_PLACE, scene_vector
from anytraverse.perception.builtin.looks import Look, attention, learn_look, look_of, vector_of
from anytraverse.perception.builtin.vocabulary import concept_of, words_for
from anytraverse.regions import Box

_GRASS = (
    Look((-0.17, 0.09), (0.4, 0.16), (-0.3, 0.5), (-2.1, 0.5), rows=(0.4, 1.0)),
    Look((-0.08, 0.08), (0.18, 0.12), (-0.1, 0.4), (-2.1, 0.5), rows=(0.4, 1.0)),
)
_DRY_GRASS = (Look((0.02, 0.06), (0.3, 0.12), (0.0, 0.35), (-2.2, 0.5), rows=(0.4, 1.0)),)
_BUSH = (Look((-0.14, 0.08), (0.18, 0.12), (-0.3, 0.35), (-1.65, 0.35), rows=(0.15, 0.56)),)
_TREE = (
    Look((-0.14, 0.09), (0.15, 0.14), (-0.1, 0.5), (-1.6, 0.45), rows=(0.0, 0.46)),
    Look((0.06, 0.08), (0.15, 0.12), (-0.6, 0.4), (-1.6, 0.45), rows=(0.0, 0.46)),
)
_DIRT = (
    Look((0.18, 0.07), (0.36, 0.12), (-0.25, 0.45), (-2.4, 0.5), rows=(0.4, 1.0)),
    Look((0.07, 0.05), (0.05, 0.07), (0.1, 0.35), (-2.2, 0.5), rows=(0.4, 1.0)),
)
_GRAVEL = (Look((0.01, 0.04), (0.03, 0.06), (0.1, 0.35), (-2.3, 0.45), rows=(0.4, 1.0)),)
_ROAD = (Look((0.0, 0.04), (0.02, 0.06), (0.15, 0.35), (-2.9, 0.45), rows=(0.4, 1.0)),)
_MUD = (Look((0.13, 0.06), (0.22, 0.12), (-0.7, 0.3), (-2.3, 0.5), rows=(0.4, 1.0)),)
_SAND = (Look((0.1, 0.05), (0.27, 0.1), (0.5, 0.3), (-2.7, 0.5), rows=(0.4, 1.0)),)
_WATER = (Look((-0.1, 0.07), (-0.12, 0.1), (0.2, 0.45), (-3.0, 0.5), rows=(0.4, 1.0)),)
_ROCK = (Look((-0.05, 0.04), (-0.08, 0.07), (0.5, 0.35), (-1.8, 0.5), rows=(0.4, 1.0)),)
_LOG = (Look((0.4, 0.09), (0.55, 0.12), (-0.4, 0.35), (-2.1, 0.5), rows=(0.4, 1.0)),)
_SKY = (
    Look((-0.11, 0.09), (-0.13, 0.12), (0.5, 0.4), (-3.1, 0.6), rows=(0.0, 0.42)),
    Look((-0.03, 0.03), (0.0, 0.04), (0.8, 0.3), (-3.2, 0.6), rows=(0.0, 0.42)),
)

LOOKS: dict[str, tuple[Look, ...]] = {
    "grass": _GRASS,
    "dry grass": _DRY_GRASS,
    "bush": _BUSH,
    "tree": _TREE,
    "vegetation": (*_GRASS, *_DRY_GRASS, *_BUSH, *_TREE),
    "trail": (*_DIRT, *_GRAVEL, *_ROAD),
    "dirt": _DIRT,
    "gravel": _GRAVEL,
    "road": _ROAD,
    "mud": _MUD,
    "sand": _SAND,
    "water": _WATER,
    "rock": _ROCK,
    "log": _LOG,
    "sky": _SKY,
}
"""Concept -> its looks."""

TRUST = {"water": WEAK, "rock": WEAK, "log": WEAK, "mud": WEAK, "sand": WEAK}
"""Concept -> its trust, where it is not "good"."""

VOCABULARY: tuple[str, ...] = words_for(LOOKS)


def meaning(word: str) -> str:
    """Return the concept of a word. Raises UnknownWordError."""
    return concept_of(word, LOOKS)


MODEL_ID = "builtin-lexicon-1"


class Lexicon:
    """Implements `Perceiver` with some forty words. Stateless: its features are the grid of measurements."""

    model_id = MODEL_ID
    vocabulary = VOCABULARY
    defaults = DefaultThresholds(roi=0.3, scene=SAME_PLACE, tile=0.25)

    def meaning(self, word: str) -> str:
        """Return the concept that a word shares with its synonyms. Raises UnknownWordError."""
        return meaning(word)

    def trust(self, word: str) -> str:
        """Return the trust in a word, "good" or "weak". Raises UnknownWordError."""
        return TRUST.get(meaning(word), "good")

    def encode(self, image: Image) -> Grid:
        """Measure an RGB frame: see `ground_features`. Raises PerceiverError."""
        check_image(image)
        return ground_features(image)

    def attend(self, features: Grid, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """Make attention maps, (len(prompts), h, w) in [0, 1]. Raises UnknownWordError, ExampleError."""
        return attention(features, [self._looks(prompt) for prompt in prompts])

    def embed(self, features: Grid) -> NDArray[np.float32]:
        """Make the scene's embedding, a unit vector: see `scene_vector`."""
        return scene_vector(features)

    def example(self, features: Grid, box: Box) -> Example:
        """Learn the look of the thing in the box. Raises ExampleError when the box is too small."""
        return Example(self.model_id, vector_of(learn_look(features, box)))

    def _looks(self, prompt: Prompt) -> tuple[Look, ...]:
        """Return the looks of the prompt's word, if it is a known one, and of its examples."""
        try:
            named = LOOKS[self.meaning(prompt.word)]
        except UnknownWordError:
            if not prompt.examples:
                raise
            named = ()
        return (*named, *(self._tapped(example) for example in prompt.examples))

    def _tapped(self, example: Example) -> Look:
        return look_of(example.vector_for(self.model_id))
