"""What words mean to the built-in network: the classes they explain, the colours that suit them, and trust.

Kinds of ground are told apart by colour alone, and only where several of them are asked for: asked for alone,
each of them means the whole trail, so that a wrong white balance makes no ground unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anytraverse.perception import WEAK
from anytraverse.perception.builtin.network import Floats

GOOD, FAIR = "good", "fair"
"""Trust: found where it stands; found, but mixed up with its like; and `WEAK`, a guess."""

_NEUTRAL = 0.5  # how well colours suit a word that is of no colour
_LEAST = 0.05


class Colour(NamedTuple):
    """Centre and spread of log R/G, of log yellow over blue, and of log light over the frame's mean."""

    redness: tuple[float, float]
    yellowness: tuple[float, float]
    light: tuple[float, float] = (0.0, 0.6)


class GroundWord(NamedTuple):
    """covers: classes that the word explains. own: how much each class speaks for it, where not by 1."""

    covers: tuple[str, ...]
    trust: str
    own: dict[str, float] = {}  # noqa: RUF012 never changed
    colour: Colour | None = None


UNKNOWN = "unknown"
"""The class of what has no name."""
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
"""Concept -> what it means. There is no snow among the frames that the network was trained on."""


def word_tables(concepts: Sequence[str], classes: Sequence[str]) -> tuple[Floats, Floats]:
    """`covers` and `own` of these concepts for `attention`, (N, C) each. KeyError for an unknown one.

    Where several of them cover a class, it speaks for the nearest of them alone: grass for "grass" and not
    also for "vegetation", which else would outweigh it where plants of both kinds may stand.
    """
    covers = np.zeros((len(concepts), len(classes)), dtype=np.float32)
    own = np.zeros_like(covers)
    for row, concept in enumerate(concepts):
        word = GROUND_WORDS[concept]
        for name in word.covers:
            covers[row, classes.index(name)] = 1.0
            own[row, classes.index(name)] = word.own.get(name, 1.0)
    return covers, np.where(own == own.max(axis=0, initial=0.0), own, np.float32(0))


def colour_fits(concepts: Sequence[str], colours: Floats) -> Floats | None:
    """How well each point's colours suit each concept, (N, h, w) in (0, 1]; None where none is of a colour.

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


def among_kin(fits: Floats, covers: Floats) -> Floats:
    """Colour fits over the best fit of all words that cover the same, (N, h, w) in (0, 1].

    So colours tell kinds of ground apart and say nothing of whether it is ground.
    """
    kin = covers @ covers.T > 0
    return np.asarray(fits / np.stack([fits[own].max(axis=0) for own in kin]), dtype=np.float32)


def reach(concepts: Sequence[str], fits: Floats | None) -> Floats | None:
    """How much of what it covers each concept explains at each point, (N, h, w); None: all do all of it.

    fits: as of `colour_fits`. A rock is of stone's colour: asked for by name it does not explain a red drum.
    """
    named = [bool(UNKNOWN in GROUND_WORDS[each].covers and GROUND_WORDS[each].colour) for each in concepts]
    if fits is None or not any(named):
        return None
    return np.where(np.array(named)[:, None, None], fits, np.float32(1))
