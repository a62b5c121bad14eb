"""Defines the `Perceiver` protocol, and makes perceivers by name.

A perceiver turns words and a frame into attention maps and an embedding. It works in three steps, so that
judging a frame again, and a new word, cost no second encoding:
encode(image) -> features; attend(features, prompts) -> maps; embed(features) -> embedding.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box
from anytraverse.release import to_install

Features = Any
"""The result of `encode`. Opaque: only the perceiver that made it can read it."""


@dataclass(frozen=True, eq=False)
class Example:
    """Holds what a perceiver learnt from a tapped box: a finite float32 vector, (n,).

    Only the model of `model_id` can read it. Raises ExampleError for another shape, or when not finite.
    """

    model_id: str
    vector: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.vector.ndim != 1 or not np.isfinite(self.vector).all():
            raise ExampleError("an example must be one finite vector: tap the thing again")

    def vector_for(self, model_id: str, length: int | None = None) -> NDArray[np.float32]:
        """Return the vector. Raises ExampleError when another model made it, or for another length."""
        if self.model_id != model_id:
            raise ExampleError(
                f"this example was tapped with {self.model_id}, not {model_id}: tap the thing again"
            )
        if length is not None and len(self.vector) != length:
            raise ExampleError("this example is not whole: tap the thing again")
        return self.vector


@dataclass(frozen=True)
class Prompt:
    """Holds what to look for: a word, tapped examples of it, or both.

    drivable: whether its weight is above 0; None: not known. A perceiver may let the words of one side share
    what they explain.
    """

    word: str
    examples: tuple[Example, ...] = ()
    drivable: bool | None = None


@dataclass(frozen=True)
class DefaultThresholds:
    """Holds the thresholds that suit a perceiver and its embedding; the configuration may override each.

    roi: mean uncertainty of the ROI above which something in it is unknown, in (0, 1].
    scene: cosine to the reference below which the scene has changed, in [-1, 1].
    tile: uncertainty of the worst tile above which something is unknown, in (0, 1]; None: not judged.
    tile_share: side of the tiles for which `tile` was chosen, over the ROI's width, in (0, 1].
    match: (number of remembered scenes, cosine that a frame needs to match one of them), measured for this
    embedding by `evaluation.scene_matching`; both rise. (): not measured, `scene` is used for any number.
    """

    roi: float
    scene: float
    tile: float | None = None
    tile_share: float = 0.25
    match: tuple[tuple[int, float], ...] = ()


class Perceiver(Protocol):
    """Turns words and a frame into attention maps and an embedding. One instance serves one thread."""

    @property
    def model_id(self) -> str:
        """Names model, weights and embedding; examples and embeddings of another id cannot be used."""

    @property
    def vocabulary(self) -> tuple[str, ...] | None:
        """The words it can ground, or None when the vocabulary is open."""

    @property
    def defaults(self) -> DefaultThresholds:
        """Thresholds that suit its maps and its embedding."""

    def meaning(self, word: str) -> str:
        """Return the name that a word shares with its synonyms ("path", "trail"). Raises UnknownWordError."""

    def encode(self, image: Image) -> Features:
        """Encode an RGB frame, (height, width, 3) uint8 of any size. The expensive step."""

    def attend(self, features: Features, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        """Make attention maps, (len(prompts), h, w) in [0, 1], at the model's own resolution.

        Values are absolute, not relative: a thing that fits no prompt is low in every map. A prompt with
        examples needs no known word; of a known word and its examples the larger attention counts.
        Raises UnknownWordError, ExampleError.
        """

    def embed(self, features: Features) -> NDArray[np.float32]:
        """Make the scene's embedding: a unit-norm vector, (d,)."""

    def example(self, features: Features, box: Box) -> Example:
        """Make an example of what the box shows. Raises ExampleError when the box is too small."""


WEAK = "weak"
"""The trust in a word whose maps are a guess: tap such a thing instead of naming it."""


def weak_words(perceiver: Perceiver, words: Iterable[str]) -> tuple[str, ...]:
    """Return those of the words whose trust is `WEAK`; none for a perceiver without `trust`.

    `trust(word)` is optional in a perceiver. It raises UnknownWordError.
    """
    trust = getattr(perceiver, "trust", None)
    return tuple(word for word in words if trust is not None and trust(word) == WEAK)


def handles_infrared(perceiver: Perceiver) -> bool:
    """Return whether its maps hold for a camera without infrared filter (NoIR), whose plants are pink.

    `infrared`, a bool, is optional in a perceiver. One without it is not trained for such pictures.
    """
    return getattr(perceiver, "infrared", False) is True


def is_independent(perceiver: Perceiver) -> bool:
    """Return whether a word's map does not depend on the other words that are asked for.

    `independent`, a bool, is optional in a perceiver.
    """
    return getattr(perceiver, "independent", False) is True


def is_joint(perceiver: Perceiver) -> bool:
    """Return whether of the words of one side the strongest has all that they explain together.

    Then a further word takes nothing from the others of its side, and what they explain does not add up.
    `joint`, a bool, is optional in a perceiver.
    """
    return getattr(perceiver, "joint", False) is True


def surroundings_of(perceiver: Perceiver, features: Features) -> NDArray[np.float32] | None:
    """Return what a frame shows apart from the place, (n,), to be compared by `History.strangeness`.

    `surroundings(features)` is optional in a perceiver. None for one without it, and for what is not finite.
    """
    make = getattr(perceiver, "surroundings", None)
    made = None if make is None else make(features)
    if made is None:
        return None
    vector = np.array(made, dtype=np.float32)
    return vector if vector.ndim == 1 and np.isfinite(vector).all() else None


KINDS: dict[str, tuple[str, str]] = {
    "builtin": ("anytraverse.perception.builtin", "make_builtin"),
    "clipseg": ("anytraverse.perception.clipseg.perceiver", "ClipSeg"),
    "classes": ("anytraverse.perception.classes.perceiver", "Classes"),
    "dense": ("anytraverse.perception.dense.perceiver", "Dense"),
}
"""Kind -> (module, its factory, called with (argument, runtime)). Imported only when the kind is chosen."""

NAMED = ("builtin", "builtin:lexicon")
"""Perceivers of this package. Here a name follows the kind; for all other perceivers it is a path."""


def make_perceiver(name: str, runtime: Runtime | None = None) -> Perceiver:
    """Make the perceiver called `name`: "kind" or "kind:argument", e.g. "builtin" or "clipseg:/opt/bundle".

    runtime: how its networks are run, by default on all cores of the CPU.
    Raises PerceiverError for an unknown kind, or a perceiver that fails to load.
    """
    kind, _, argument = name.partition(":")
    if kind not in KINDS:
        raise PerceiverError(f'no perceiver is called "{kind}": choose one of {", ".join(KINDS)}')
    module, attribute = KINDS[kind]
    try:
        factory = getattr(importlib.import_module(module), attribute)
    except ImportError as error:
        raise PerceiverError(f'perceiver "{kind}" needs {error.name}: {to_install("rover")}') from error
    perceiver: Perceiver = factory(argument, runtime or Runtime())
    return perceiver
