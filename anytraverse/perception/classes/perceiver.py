"""Perceives with any segmentation network: its classes are the words.

What belongs to no class that the operator asked for is uncertain; see `attention_of`. Taps, and a good scene
embedding, need a network with a second output called "features". Without it taps are refused, and scenes are
told apart only by the layout of their classes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.manifest import MANIFEST, Manifest, read_manifest, verify
from anytraverse.bundle.records import choose_precision
from anytraverse.errors import BundleError, ExampleError, PerceiverError, UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.classes.attention import attention_of, learn, likeness, resized_to
from anytraverse.perception.classes.details import read_details
from anytraverse.perception.classes.network import FEATURES, Network, Segmented
from anytraverse.perception.classes.scene import feature_vector, layout_vector
from anytraverse.perception.resizing import Resizer
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box

KIND = "classes"
PART, WEIGHTS = "image", "weights"
"""The bundle's parts: the network, and its weights where they are in a file of their own."""


class Classes:
    """Implements `Perceiver` for kind "classes".

    `precision` is the bundle's variant in use, and `why` the reason for that choice.
    """

    def __init__(self, argument: str, runtime: Runtime) -> None:
        """Load the network and run it once. argument: the bundle's folder.

        Raises BundleError for a bundle that is damaged, of another kind or does not fit its network, and
        PerceiverError.
        """
        if not argument:
            raise PerceiverError('classes needs its bundle: write "classes:FOLDER"')
        folder = Path(argument).expanduser()
        self.manifest: Manifest = read_manifest(folder, KIND)
        self.precision, self.why = choose_precision(folder, self.manifest, runtime)
        verify(folder, self.manifest, precision=self.precision)
        if self.manifest.image.crop:
            raise BundleError(f"{folder}: frames are cropped, and their edges unseen: make the bundle again")
        details = read_details(self.manifest.details, f"{folder / MANIFEST}: details")
        self._words, self._shares = details.words, details.shares
        self._resize = Resizer(self.manifest.image)
        self._network = Network(folder / self.manifest.file(self.precision, PART), details, runtime)
        self._network.warm_up(self.manifest.image.height, self.manifest.image.width)

    @property
    def model_id(self) -> str:
        """Names the network, its words and its input."""
        return self.manifest.model_id

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """The names of the classes, then their synonyms; not those that the bundle ignores."""
        return self._words.vocabulary

    @property
    def defaults(self) -> DefaultThresholds:
        """The bundle's thresholds."""
        return self.manifest.thresholds

    def meaning(self, word: str) -> str:
        """Return the name of the class that the word means. Raises UnknownWordError."""
        return self._words.classes[self._words.index(word)].name

    def encode(self, image: Image) -> Segmented:
        """Run the network. Raises PerceiverError, also when its output is not finite."""
        return self._network(self._resize(image))

    def attend(self, features: Segmented, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """Make attention maps, (len(prompts), h, w) in [0, 1]. Raises UnknownWordError, ExampleError."""
        classes = [self._class_of(prompt) for prompt in prompts]
        asked = [index for index in classes if index is not None]
        of_words = iter(attention_of(features.values, asked, self._shares))
        maps = np.zeros((len(prompts), *features.values.shape[1:]), dtype=np.float32)
        for each, index, prompt in zip(maps, classes, prompts, strict=True):
            if index is not None:
                each[...] = next(of_words)
            for example in prompt.examples:
                found = likeness(self._directions(features), example.vector_for(self.model_id))
                np.maximum(each, resized_to(found, each.shape), out=each)
        return maps

    def embed(self, features: Segmented) -> NDArray[np.float32]:
        """Make the scene's embedding, a unit vector, from the features or else the layout of classes."""
        if features.features is not None:
            return feature_vector(features.features)
        return layout_vector(features.values, self._shares)

    def example(self, features: Segmented, box: Box) -> Example:
        """Learn the features of what the box shows. Raises ExampleError, also without features."""
        return Example(self.model_id, learn(self._directions(features), box))

    def _class_of(self, prompt: Prompt) -> int | None:
        try:
            return self._words.index(prompt.word)
        except UnknownWordError:
            if not prompt.examples:
                raise
            return None

    def _directions(self, seen: Segmented) -> NDArray[np.float32]:
        if seen.directions is None:
            raise ExampleError(
                "this network cannot learn from taps: name the thing by one of its classes, or export the "
                f'network with its last features as a second output called "{FEATURES}" and make its bundle '
                "again"
            )
        return seen.directions
