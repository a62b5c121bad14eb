"""Perceives with a dense model from a bundle: SigLIP 2 or TIPSv2, whose patches are compared with words.

SigLIP 2: Tschannen et al., arXiv 2502.14786. TIPSv2: Cao et al., CVPR 2026, arXiv 2604.12012.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.manifest import Manifest, read_manifest, verify
from anytraverse.bundle.records import CheckRuntime, check_command, choose_precision
from anytraverse.errors import BundleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Example, Prompt
from anytraverse.perception.classes.attention import learn, likeness
from anytraverse.perception.dense.details import DenseDetails, ScoreCalibration, read_details
from anytraverse.perception.dense.words import WordEmbeddings, unit
from anytraverse.perception.resizing import Resizer
from anytraverse.perception.runtime import Runtime, open_session, run_session
from anytraverse.perception.text_tower import TextTower, open_array
from anytraverse.preferences import clean_word
from anytraverse.regions import Box

Array = NDArray[np.float32]

KIND = "dense"
_UNMEASURED = ScoreCalibration(threshold=0.0, temperature=0.05, frames=0, chance=1.0)
"""For a check alone, which times the parts before it calibrates."""
_UNIT = 1e-3
"""By how much the length of an embedding may differ from 1."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Holds a frame's features: directions (d, h, w) and the scene's embedding (d,), all of length 1."""

    directions: Array
    scene: Array


class Dense:
    """Implements `Perceiver` for kind "dense". Its vocabulary is open.

    A word's score at a patch is the patch's cosine to the word, less its mean cosine to the bundle's absent
    words: things that are not expected there. Its attention is a sigmoid of the score, calibrated so that
    absent words have little. `precision` is the bundle's variant in use, and `why` the reason for it.
    """

    vocabulary = None
    independent = True
    """True: a word's map does not depend on the other words asked for."""

    def __init__(self, argument: str, runtime: Runtime) -> None:
        """Load the networks. argument: the bundle's folder. Raises BundleError and PerceiverError.

        A bundle that is not calibrated is refused, unless it is loaded by a check.
        """
        if not argument:
            raise PerceiverError('dense needs its bundle: write "dense:FOLDER"')
        self._folder = Path(argument).expanduser()
        self.manifest: Manifest = read_manifest(self._folder, KIND)
        self.details: DenseDetails = read_details(self.manifest.details, f"{self._folder}: details")
        if self.details.calibration is None and not isinstance(runtime, CheckRuntime):
            raise BundleError(not_calibrated(self._folder))
        self.calibration = self.details.calibration or _UNMEASURED
        self.precision, self.why = choose_precision(self._folder, self.manifest, runtime)
        verify(self._folder, self.manifest, precision=self.precision)
        pieces = [
            self._file(part) for part in sorted(self.manifest.variants["fp32"]) if part.startswith("text-")
        ]
        tower = TextTower(pieces, self._file("tokens"), runtime)
        known = dict(zip(self.details.words, self._embeddings("words", self.details.words), strict=True))
        self._words = WordEmbeddings(tower, self._file("tokenizer"), self.details.templates, known)
        self.absent = self._embeddings("absent", self.details.absent)
        self._neutral = self.absent.mean(axis=0)
        self._image = open_session(self._file("image"), runtime)
        self._scores = open_session(self._file("scores"), runtime)
        self._resize = Resizer(self.manifest.image)

    @property
    def model_id(self) -> str:
        """Names the weights and the size; templates, precision and calibration are not part of it."""
        return self.manifest.model_id

    @property
    def defaults(self) -> DefaultThresholds:
        """The bundle's thresholds."""
        return self.manifest.thresholds

    def meaning(self, word: str) -> str:
        """Return the word itself, in its clean spelling: every word is known, and there are no synonyms."""
        return clean_word(word)

    def encode(self, image: Image) -> Patches:
        """Run the image tower, which is nearly all of a frame's cost. Raises PerceiverError."""
        patches, scene = run_session(self._image, {"frame": self._resize(image)}, ("patches", "scene"))
        grid = self.details.grid
        if patches.shape != (grid * grid, self.details.width) or scene.shape != (self.details.width,):
            raise BundleError("the image network does not fit its manifest: export the bundle again")
        directions = np.ascontiguousarray(unit(patches).T)
        return Patches(directions.reshape(-1, grid, grid), unit(scene))

    def attend(self, features: Patches, prompts: Sequence[Prompt]) -> Array:
        """Make attention maps, (len(prompts), h, w) in [0, 1]. Raises PerceiverError and ExampleError."""
        scores = self.scores(features, [prompt.word for prompt in prompts])
        rising = (scores - self.calibration.threshold) / self.calibration.temperature
        maps = 0.5 + 0.5 * np.tanh(0.5 * rising)  # a sigmoid that cannot overflow
        for each, prompt in zip(maps, prompts, strict=True):
            for example in prompt.examples:
                found = likeness(features.directions, example.vector_for(self.model_id))
                np.maximum(each, found, out=each)
        return np.asarray(maps, dtype=np.float32)

    def scores(self, features: Patches, words: Sequence[str]) -> Array:
        """Calculate the scores of words, (len(words), h, w), each in [-2, 2]. Raises PerceiverError."""
        depth, *grid = features.directions.shape
        if not words:
            return np.zeros((0, *grid), dtype=np.float32)
        embeddings = self._words.embeddings(words)
        if any(each.shape != self._neutral.shape for each in embeddings):
            raise BundleError("the text network does not fit its manifest: export the bundle again")
        wanted = np.stack(embeddings) - self._neutral
        given = {"words": wanted, "directions": features.directions.reshape(depth, -1)}
        (made,) = run_session(self._scores, given, ("scores",))
        if made.shape != (len(words), grid[0] * grid[1]):
            raise BundleError("the scores network does not fit its manifest: export the bundle again")
        return np.asarray(made, dtype=np.float32).reshape(-1, *grid)

    def embed(self, features: Patches) -> Array:
        """Make the scene's embedding, a unit vector: the model's own, of the same pass."""
        return features.scene

    def example(self, features: Patches, box: Box) -> Example:
        """Learn the features of what the box shows. Raises ExampleError, also for a box of few patches."""
        return Example(self.model_id, learn(features.directions, box))

    def _embeddings(self, part: str, words: Sequence[str]) -> Array:
        """Read the embeddings of these words, (n, d). Raises BundleError."""
        path, shape = self._file(part), (len(words), self.details.width)
        vectors = open_array(path)
        if vectors.shape != shape or vectors.dtype != np.float32:
            raise BundleError(f"{path} holds no {shape[0]} embeddings of {shape[1]} values: export it again")
        if not (np.abs(np.linalg.norm(vectors, axis=1) - 1.0) < _UNIT).all():  # also for NaN
            raise BundleError(f"{path} holds embeddings that are not of length 1: export it again")
        return np.array(vectors)

    def _file(self, part: str) -> Path:
        return self._folder / self.manifest.file(self.precision, part)


def not_calibrated(folder: Path) -> str:
    """Say why a bundle does not run before it is calibrated, and how to do that."""
    return (
        f"{folder} is not calibrated, so that nothing could be told to be unknown: "
        f"run {check_command(folder)} with frames of your own terrain"
    )
