"""The words of the built-in perceiver and how each of them looks.

Centres and spreads of the features in ground_features.py, from labelled frames of forest tracks, gravel roads
and meadows (`bench/fit_lexicon.py`), rounded and widened by hand for other cameras.
"""

from __future__ import annotations

from anytraverse.perception import WEAK
from anytraverse.perception.looks import Look
from anytraverse.perception.vocabulary import concept_of, words_for

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
"""Concept -> how far it can be trusted, where not "good"."""

VOCABULARY: tuple[str, ...] = words_for(LOOKS)


def meaning(word: str) -> str:
    """The concept of a word. Raises UnknownWordError."""
    return concept_of(word, LOOKS)
