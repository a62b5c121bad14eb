"""Perceives with CLIPSeg, the paper's model, from a bundle: any word and any tapped thing is a prompt.

CLIPSeg: Lüddecke and Ecker, "Image Segmentation Using Text and Image Prompts", CVPR 2022.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.manifest import Manifest, read_manifest, verify
from anytraverse.bundle.records import choose_precision
from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.clipseg.prompts import Prompts
from anytraverse.perception.resizing import Resizer
from anytraverse.perception.runtime import Runtime, open_session, run_session
from anytraverse.preferences import clean_word
from anytraverse.regions import Box

if TYPE_CHECKING:
    import onnxruntime

Array = NDArray[np.float32]

_LEAST_SIDE = 16
"""The least pixels of a tapped box's shorter side; a smaller box shows only a blur."""
_CONTEXT = 1.2
"""A tapped box is enlarged by this factor: some surroundings help to recognise a thing."""

_AT_ONCE = 2
"""Prompts in one run of the decoder: more are no faster, and need more memory."""


@dataclass(eq=False)
class Activations:
    """Holds the image tower's output for a frame, and caches what was computed from it.

    reduced: (steps, tokens, reduced), for the decoder. deep: (tokens, width), for the embedding.
    maps: a prompt's word or examples -> its attention map, cached while it is asked for.
    """

    image: Image
    reduced: Array
    deep: Array
    maps: dict[object, Array] = field(default_factory=dict)
    embedding: Array | None = None


class ClipSeg:
    """Implements `Perceiver` for kind "clipseg". Its vocabulary is open.

    `precision` is the bundle's variant in use, and `why` the reason for that choice.
    """

    vocabulary = None
    independent = True
    """True: a word's map does not depend on the other words asked for."""

    def __init__(self, argument: str, runtime: Runtime) -> None:
        """Load the networks. argument: the bundle's folder. Raises BundleError and PerceiverError."""
        if not argument:
            raise PerceiverError('clipseg needs its bundle: write "clipseg:FOLDER"')
        folder = Path(argument).expanduser()
        manifest = read_manifest(folder, "clipseg")
        self.precision, self.why = choose_precision(folder, manifest, runtime)
        verify(folder, manifest, precision=self.precision)
        self._folder = folder
        self._manifest = manifest
        self._runtime = runtime
        pieces = [self._file(part) for part in sorted(manifest.variants["fp32"]) if part.startswith("text-")]
        self._prompts = Prompts(pieces, self._file("tokenizer"), self._file("tokens"), runtime)
        self._scene = self._session("scene") if manifest.scene_image is not None else None
        self._image = self._session("image")
        self._decoder = self._session("decoder")
        self._resize = Resizer(manifest.image)
        self._tail = self._session("tail") if self._scene is None else None
        self._resize_scene = Resizer(manifest.scene_image) if manifest.scene_image is not None else None

    @property
    def model_id(self) -> str:
        """Names the weights, the size and the embedding; the precision is not part of it."""
        return self._manifest.model_id

    @property
    def defaults(self) -> DefaultThresholds:
        """The bundle's thresholds."""
        return self._manifest.thresholds

    @property
    def manifest(self) -> Manifest:
        """The bundle's manifest."""
        return self._manifest

    def meaning(self, word: str) -> str:
        """Return the word itself, in its clean spelling: every word is known, and there are no synonyms."""
        return clean_word(word)

    def encode(self, image: Image) -> Activations:
        """Run the image tower, which is nearly all of a frame's cost. Raises PerceiverError."""
        reduced, deep = run_session(self._image, {"frame": self._resize(image)})
        if not np.isfinite(reduced).all():
            raise PerceiverError("the image network's output is not finite")
        return Activations(image, reduced, deep)

    def attend(self, features: Activations, prompts: Sequence[Prompt]) -> Array:
        """Make attention maps, (len(prompts), h, w) in [0, 1]: the decoder's probabilities for each prompt.

        The examples of one prompt are averaged to one condition. Maps that were made for this frame before
        are taken from its cache. Raises PerceiverError and ExampleError.
        """
        asked = self._conditions(prompts)
        wanted = {key: condition for each in asked for key, condition in each.items()}
        missing = [key for key in wanted if key not in features.maps]
        if missing:
            # drop maps that are not asked for any more, so that the cache cannot grow without limit
            features.maps = {key: features.maps[key] for key in wanted if key in features.maps}
            for start in range(0, len(missing), _AT_ONCE):
                keys = missing[start : start + _AT_ONCE]
                maps = self._decode(features.reduced, np.stack([wanted[key] for key in keys]))
                features.maps |= dict(zip(keys, maps, strict=True))
        edge = self._decoder.get_outputs()[0].shape[1:]
        joined = np.empty((len(prompts), *edge), dtype=np.float32)
        for row, each in zip(joined, asked, strict=True):
            np.maximum.reduce([features.maps[key] for key in each], out=row)
        return joined

    def embed(self, features: Activations) -> Array:
        """Make the scene's embedding, a unit vector, with the scene encoder or else the image tower."""
        if features.embedding is None:
            if self._scene is not None and self._resize_scene is not None:
                (vector,) = run_session(self._scene, {"frame": self._resize_scene(features.image)})
            else:
                vector = self._embed_deep(features.deep)
            length = float(np.linalg.norm(vector))
            if not np.isfinite(length) or length == 0.0:
                raise PerceiverError("the scene's embedding is not finite")
            features.embedding = np.asarray(vector / length, dtype=np.float32)
        return features.embedding

    def example(self, features: Activations, box: Box) -> Example:
        """Make the CLIP embedding of what the box shows, by encoding the box's crop. Raises ExampleError."""
        image, size = features.image, features.image.shape[:2]
        if min(image[box.slices(*size)].shape[:2]) < _LEAST_SIDE:
            raise ExampleError("the box is too small to learn from: draw a larger one around the thing")
        crop = image[box.grown(_CONTEXT).slices(*size)]
        vector = self._embed_deep(self.encode(crop).deep)
        return Example(self.model_id, np.asarray(vector, dtype=np.float32))

    def _decode(self, reduced: Array, conditions: Array) -> Array:
        given = {"activations": reduced, "conditions": conditions}
        maps, magnitudes = run_session(self._decoder, given)
        if not np.isfinite(magnitudes).all():
            raise PerceiverError("the decoder's output is not finite")
        return maps

    def _conditions(self, prompts: Sequence[Prompt]) -> list[dict[object, Array]]:
        """Return the decoder's conditions for each prompt: of its word, and the mean of its examples."""
        words = self._prompts.conditions([prompt.word for prompt in prompts])
        asked: list[dict[object, Array]] = []
        for prompt, condition in zip(prompts, words, strict=True):
            asked.append({prompt.word: condition})
            if prompt.examples:
                vectors = [example.vector_for(self.model_id, len(condition)) for example in prompt.examples]
                asked[-1][prompt.examples] = np.mean(vectors, axis=0)
        return asked

    def _embed_deep(self, deep: Array) -> Array:
        # beside a scene encoder only taps need the tail: it is opened for them and released after
        tail = self._tail or open_session(self._file("tail"), self._runtime, once=True)
        (vector,) = run_session(tail, {"deep": deep})
        return vector

    def _file(self, part: str) -> Path:
        return self._folder / self._manifest.file(self.precision, part)

    def _session(self, part: str) -> onnxruntime.InferenceSession:
        return open_session(self._file(part), self._runtime)
