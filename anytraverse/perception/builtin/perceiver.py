"""Perceives ground by words, things by taps, and the scene, with the built-in network.

docs/builtin.md says what it was trained on, how good it is, and what it is bad at.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from anytraverse.errors import PerceiverError, UnknownWordError
from anytraverse.frame import Image, check_image
from anytraverse.perception import WEAK, DefaultThresholds, Example, Prompt
from anytraverse.perception.builtin.attention import UNKNOWN, attention, posteriors
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import (
    GREATEST_HEIGHT,
    WIDTH,
    Outputs,
    network_input,
    open_network,
)
from anytraverse.perception.builtin.scene import (
    SAME_PLACE,
    scene_summary,
    scene_vector,
    surroundings_summary,
    surroundings_vector,
)
from anytraverse.perception.builtin.taps import (
    COLOURS,
    changed_views,
    learn_tap,
    likeness,
    strange_part,
    tap_cells,
    whitened,
    whole_thing,
)
from anytraverse.perception.builtin.vocabulary import concept_of, words_for
from anytraverse.perception.builtin.words import (
    GROUND_WORDS,
    colour_fits,
    own_weights,
    reach,
    relative_fits,
)
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box
from anytraverse.regular_file import read_regular

SHIPPED = Path(__file__).parent.parent / "data" / "builtin.onnx"
"""The network of this package; its calibration lies beside it, ending in .npz."""
_LARGEST = 1 << 30
"""Bytes of a network that are read at most."""

_STRANGENESS_QUANTILE = 0.75
"""Of the strangeness over the strange part of a tapped box: its edges are mixed with the background."""


@dataclass(eq=False)
class GroundOutputs:
    """Holds a frame's input (1, 3, H, W), the network's outputs and the class probabilities (C, h, w)."""

    frame: Floats
    outputs: Outputs
    probabilities: Floats

    @cached_property
    def cells(self) -> Floats:
        """Features and colours, (h, w, T), for taps and for words of a colour."""
        return tap_cells(self.outputs, self.frame)


class GroundNetwork:
    """Implements `Perceiver` with a trained network, the package's own or one of the user's."""

    vocabulary = words_for(GROUND_WORDS)
    joint = True  # see `attention`
    infrared = True  # its training shows frames as a camera without infrared filter sees them
    DEFAULTS = DefaultThresholds(
        roi=0.4,
        scene=SAME_PLACE,  # the calibration scales the embedding to this threshold
        tile_share=0.08,  # small things noticed against false stops
    )
    """Of every network; the tile's threshold comes with its calibration."""

    def __init__(self, model: Path, runtime: Runtime) -> None:
        """Load `model`, an .onnx file with its .npz beside it, and run it once.

        Raises PerceiverError for files that are missing, damaged, or not of the same training.
        """
        stored, numbers = _read_file(model), _read_file(model.with_suffix(".npz"))
        self.model_id = f"builtin-net-{hashlib.sha256(stored + numbers).hexdigest()[:12]}"
        self._calibration = Calibration.load(model.with_suffix(".npz"))
        self._run = open_network(model, runtime)
        self._check(model.name)
        match = tuple((round(float(number)), float(least)) for number, least in self._calibration.scene_match)
        self.defaults = replace(self.DEFAULTS, tile=self._calibration.tile, match=match)

    def meaning(self, word: str) -> str:
        """Return the concept that a word shares with its synonyms. Raises UnknownWordError."""
        return concept_of(word, GROUND_WORDS)

    def trust(self, word: str) -> str:
        """Return the trust in a word, "good", "fair" or "weak". Raises UnknownWordError."""
        return GROUND_WORDS[self.meaning(word)].trust

    def encode(self, image: Image) -> GroundOutputs:
        """Run the network, which is nearly all of a frame's cost. Raises PerceiverError."""
        check_image(image)
        return self._ground(network_input(image))

    def attend(self, features: GroundOutputs, prompts: Sequence[Prompt]) -> Floats:
        """Make attention maps, (len(prompts), h, w) in [0, 1]. Raises UnknownWordError, ExampleError."""
        maps = np.zeros((len(prompts), *features.probabilities.shape[1:]), dtype=np.float32)
        concepts = [self._concept(prompt) for prompt in prompts]
        known = [
            (concept, prompt.drivable)
            for concept, prompt in zip(concepts, prompts, strict=True)
            if concept is not None
        ]
        maps[[concept is not None for concept in concepts]] = self._words(features, known)
        if any(prompt.examples for prompt in prompts):
            white = whitened(features.cells, self._calibration)
            strange = self._strangeness(features)
            for each, prompt in zip(maps, prompts, strict=True):
                if not prompt.examples:
                    continue
                found = np.max([self._tapped(white, strange, one) for one in prompt.examples], axis=0)
                if prompt.drivable is False:  # beside a tuft that may be driven over, nothing else may be
                    found = whole_thing(found, strange)
                np.maximum(each, found, out=each)
        return maps

    def embed(self, features: GroundOutputs) -> Floats:
        """Make the scene's embedding, a unit vector: see `scene_vector`. Raises PerceiverError."""
        vector = scene_vector(features.outputs, self._calibration)
        if not np.isfinite(vector).all():
            raise PerceiverError("the scene's embedding is not finite")
        return vector

    def surroundings(self, features: GroundOutputs) -> Floats:
        """Make the vector of the surroundings: see `surroundings_vector`."""
        return surroundings_vector(features.outputs, self._calibration)

    def example(self, features: GroundOutputs, box: Box) -> Example:
        """Learn what the box shows, by encoding the frame in six lights. Raises ExampleError."""
        pixels = features.frame[0].transpose(1, 2, 0).astype(np.uint8)
        views = [
            self._ground(np.ascontiguousarray(view.transpose(2, 0, 1)[None], dtype=np.float32)).cells
            for view in changed_views(pixels)
        ]
        strange = self._strangeness(features)
        learnt = learn_tap(views, box, self._calibration, strange)
        surely = np.quantile(strange[strange_part(box.mask(*strange.shape), strange)], _STRANGENESS_QUANTILE)
        return Example(self.model_id, np.append(learnt, surely).astype(np.float32))

    def _check(self, name: str) -> None:
        """Run the network once, and check that calibration, words and network fit together."""
        numbers = self._calibration
        outputs = self._run(np.zeros((1, 3, GREATEST_HEIGHT, WIDTH), dtype=np.float32))
        middle = len(outputs.eighth) + len(outputs.sixteenth)
        taps = len(outputs.features) + len(outputs.eighth) + COLOURS
        places, around = len(scene_summary(outputs)), len(surroundings_summary(outputs))
        shapes = {
            "bias": (numbers.bias.shape, (len(outputs.logits),)),
            "distance_mean": (numbers.distance_mean.shape, (middle,)),
            "distance_whitening": (numbers.distance_whitening.shape, (middle, middle)),
            "distance_centres": (numbers.distance_centres.shape[1:], (middle,)),
            "limits": (numbers.limits.shape, (2,)),
            "tap_mean": (numbers.tap_mean.shape, (taps,)),
            "tap_whitening": (numbers.tap_whitening.shape, (taps, taps)),
            "scene_mean": (numbers.scene_mean.shape, (places,)),
            "scene_projection": (numbers.scene_projection.shape[1:], (places,)),
            "scene_match": (numbers.scene_match.shape[1:], (2,)),
            "surroundings_mean": (numbers.surroundings_mean.shape, (around,)),
            "surroundings_whitening": (numbers.surroundings_whitening.shape, (around, around)),
        }
        covered = {UNKNOWN} | {name for word in GROUND_WORDS.values() for name in word.covers}
        if (
            len(numbers.classes) != len(outputs.logits)
            or any(found != wanted for found, wanted in shapes.values())
            or not covered <= set(numbers.classes)
            or not (numbers.limits > 0).all()
            or not (numbers.slope > 0 and 0 < numbers.tile <= 1)
            or not -1 < numbers.scene_threshold <= SAME_PLACE
        ):
            raise PerceiverError(
                f"{name} and its .npz are no pair of one training: copy both files again, or fit it again"
            )

    def _ground(self, frame: Floats) -> GroundOutputs:
        outputs = self._run(frame)
        if not all(np.isfinite(output).all() for output in outputs):
            raise PerceiverError("the network's output is not finite: its file is broken, install it again")
        return GroundOutputs(frame, outputs, posteriors(outputs, self._calibration))

    def _concept(self, prompt: Prompt) -> str | None:
        """Return the concept of the prompt's word; None where only its examples count.

        A weak word with examples counts by these alone: by its name, "rock" would also explain the next
        unknown thing.
        """
        try:
            concept = self.meaning(prompt.word)
        except UnknownWordError:
            if not prompt.examples:
                raise
            return None
        return None if prompt.examples and GROUND_WORDS[concept].trust == WEAK else concept

    def _words(self, seen: GroundOutputs, words: Sequence[tuple[str, bool | None]]) -> Floats:
        """Make the attention maps of concepts, each with whether it is drivable."""
        concepts = [concept for concept, _ in words]
        own = own_weights(concepts, self._calibration.classes)
        fits = None
        if any(GROUND_WORDS[concept].colour for concept in concepts):
            fits = colour_fits(concepts, seen.cells[..., -COLOURS:][..., :3])
        far = reach(concepts, fits)
        kinds = None if fits is None else relative_fits(fits, own > 0)
        return attention(seen.probabilities, own, [drivable for _, drivable in words], kinds, far)

    def _tapped(self, white: Floats, strange: Floats, example: Example) -> Floats:
        vector = example.vector_for(self.model_id, len(self._calibration.tap_mean) + 3)
        found = likeness(white, vector[:-1]) * (1 - (1 - strange) * np.clip(vector[-1], 0, 1)) ** 2
        return np.asarray(found, dtype=np.float32)

    def _strangeness(self, seen: GroundOutputs) -> Floats:
        """Return how little all named classes together explain each point, (h, w) in [0, 1].

        A thing that was strange when it was tapped is found only where the frame is strange: by its look
        alone, a brown drum is also found in brown earth. A thing that the network took for known ground when
        it was tapped is searched everywhere.
        """
        strange: Floats = seen.probabilities[self._calibration.classes.index(UNKNOWN)]
        return strange


def _read_file(path: Path) -> bytes:
    try:
        return read_regular(path, _LARGEST)
    except OSError as error:
        raise PerceiverError(
            f"{path}: {(error.strerror or str(error)).lower()}: give a network that "
            "a training wrote, FILE.onnx with FILE.npz beside it"
        ) from error
