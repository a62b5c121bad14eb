"""Defines the words of the built-in network: the classes they explain, their colours and their trust.

Kinds of ground (dirt, gravel, sand) are told apart by colour alone, and only where several of them are asked
for. One of them alone means the whole trail, so that a wrong white balance makes no ground unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception import WEAK
from anytraverse.perception.builtin.attention import UNKNOWN
from anytraverse.perception.builtin.calibration import Floats

GOOD, FAIR = "good", "fair"
"""Trust in a word. Good: it is found. Fair: it is found, but confused with similar ones. `WEAK`: a guess."""

_NEUTRAL = 0.5  # colour fit of a word without a colour
_LEAST = 0.05  # lowest colour fit


class Colour(NamedTuple):
    """Holds (centre, spread) of log R/G, of log yellow over blue, and of log light over the frame's mean."""

    redness: tuple[float, float]
    yellowness: tuple[float, float]
    light: tuple[float, float] = (0.0, 0.6)


class GroundWord(NamedTuple):
    """Holds what a word means.

    covers: the classes that it explains. own: class -> its weight as evidence for the word, where not 1.
    """

    covers: tuple[str, ...]
    trust: str
    own: dict[str, float] = {}  # noqa: RUF012 never changed
    colour: Colour | None = None


_TRAIL = ("smooth trail", "rough trail")
_TALL = ("low vegetation", "high vegetation")

GROUND_WORDS: dict[str, GroundWord] = {
    "trail": GroundWord(_TRAIL, GOOD),
    "dirt": GroundWord(_TRAIL, FAIR, colour=Colour((0.16, 0.1), (0.33, 0.15), (-0.1, 0.5))),
    "gravel": GroundWord(_TRAIL, FAIR, colour=Colour((0.02, 0.06), (0.05, 0.1), (0.1, 0.5))),
    "road": GroundWord(_TRAIL, FAIR, {"rough trail": 0.3}, Colour((0.0, 0.06), (0.0, 0.1), (0.1, 0.5))),
    "mud": GroundWord(_TRAIL, WEAK, {"smooth trail": 0.5}, Colour((0.13, 0.08), (0.22, 0.15), (-0.8, 0.3))),
    "sand": GroundWord(_TRAIL, WEAK, colour=Colour((0.1, 0.07), (0.28, 0.12), (0.4, 0.3))),
    "grass": GroundWord(("grass",), GOOD),
    "dry grass": GroundWord(("grass",), FAIR, colour=Colour((0.02, 0.07), (0.3, 0.15), (0.1, 0.5))),
    "bush": GroundWord(_TALL, GOOD, {"high vegetation": 0.5}),
    "tree": GroundWord(_TALL, GOOD, {"low vegetation": 0.5}),
    "vegetation": GroundWord((*_TALL, "grass"), GOOD, {"grass": 0.5}),
    "water": GroundWord(("water",), WEAK),
    "sky": GroundWord(("sky",), GOOD),
    "obstacle": GroundWord((UNKNOWN,), WEAK),
    "rock": GroundWord((UNKNOWN,), WEAK, colour=Colour((-0.03, 0.06), (-0.05, 0.1), (0.3, 0.6))),
    "log": GroundWord((UNKNOWN,), WEAK, colour=Colour((0.35, 0.15), (0.5, 0.2), (-0.4, 0.5))),
}
"""Concept -> its meaning. "snow" is missing, since no frame of the training shows any."""


def own_weights(concepts: Sequence[str], classes: Sequence[str]) -> Floats:
    """Make `own` of these concepts for `attention`, (N, C). Raises KeyError.

    Where several concepts cover a class, it is evidence only for the one with the largest weight: grass for
    "grass" and not also for "vegetation", which would otherwise win where both kinds of plants are likely.
    """
    own = np.zeros((len(concepts), len(classes)), dtype=np.float32)
    for row, concept in enumerate(concepts):
        word = GROUND_WORDS[concept]
        for name in word.covers:
            own[row, classes.index(name)] = word.own.get(name, 1.0)
    return np.where(own == own.max(axis=0, initial=0.0), own, np.float32(0))


def colour_fits(concepts: Sequence[str], colours: Floats) -> Floats | None:
    """Calculate how well each point's colours suit each concept, (N, h, w) in (0, 1]; None without a colour.

    colours: (h, w, 3), the first three of the colours in `tap_cells`.
    """
    chosen = [GROUND_WORDS[concept].colour for concept in concepts]
    if not any(chosen):
        return None
    fits = np.full((len(concepts), *colours.shape[:2]), _NEUTRAL, dtype=np.float32)
    for row, colour in enumerate(chosen):
        if colour is not None:
            centre, spread = np.array(colour, dtype=np.float32).T
            distance = (((colours - centre) / spread) ** 2).sum(axis=-1)
            fits[row] = np.maximum(np.exp(-0.125 * distance), _LEAST)
    return fits


def relative_fits(fits: Floats, covers: NDArray[np.bool_]) -> Floats:
    """Divide colour fits by the best fit of all words that share a class, (N, C, h, w) in [0, 1].

    covers (N, C): whether a word explains a class; where not, the fit is 0. So colours tell kinds of ground
    apart, and do not decide whether it is ground at all: each class fits some word fully.
    """
    shared = covers[:, :, None, None] * fits[:, None]
    return np.asarray(shared / np.maximum(shared.max(axis=0), 1e-9), dtype=np.float32)


def reach(concepts: Sequence[str], fits: Floats | None) -> Floats | None:
    """Calculate the share of its classes that each concept explains at each point, (N, h, w); None: all.

    fits: of `colour_fits`. Only a thing with a colour explains less than all: a rock has the colour of stone,
    so that the word "rock" does not explain a red drum.
    """
    named = [bool(UNKNOWN in GROUND_WORDS[each].covers and GROUND_WORDS[each].colour) for each in concepts]
    if fits is None or not any(named):
        return None
    return np.where(np.array(named)[:, None, None], fits, np.float32(1))
