"""Looks up the words of the built-in perceivers: their synonyms, and the nearest to an unknown word."""

from __future__ import annotations

from collections.abc import Collection
from difflib import SequenceMatcher

from anytraverse.errors import UnknownWordError
from anytraverse.preferences import clean_word

SYNONYMS: dict[str, str] = {
    "meadow": "grass",
    "lawn": "grass",
    "green grass": "grass",
    "hay": "dry grass",
    "straw": "dry grass",
    "bushes": "bush",
    "shrub": "bush",
    "shrubs": "bush",
    "undergrowth": "bush",
    "trees": "tree",
    "forest": "tree",
    "woods": "tree",
    "plants": "vegetation",
    "foliage": "vegetation",
    "path": "trail",
    "track": "trail",
    "dirt path": "dirt",
    "dirt road": "dirt",
    "dirt track": "dirt",
    "earth": "dirt",
    "soil": "dirt",
    "gravel road": "gravel",
    "gravel path": "gravel",
    "pebbles": "gravel",
    "asphalt": "road",
    "pavement": "road",
    "concrete": "road",
    "puddle": "water",
    "pond": "water",
    "rocks": "rock",
    "stone": "rock",
    "boulder": "rock",
    "logs": "log",
    "trunk": "log",
    "thing": "obstacle",
    "obstacles": "obstacle",
}
"""Word -> the concept that it means."""


def words_for(concepts: Collection[str]) -> tuple[str, ...]:
    """Return the concepts, then their synonyms."""
    return (*concepts, *(word for word, concept in SYNONYMS.items() if concept in concepts))


def concept_of(word: str, concepts: Collection[str]) -> str:
    """Return the concept that the word means. Raises UnknownWordError, which lists the nearest ones first."""
    word = clean_word(word)
    concept = SYNONYMS.get(word, word)
    if concept not in concepts:
        raise UnknownWordError(word, nearest(word, concepts))
    return concept


def nearest(word: str, concepts: Collection[str]) -> tuple[str, ...]:
    """Sort the concepts by how similar their spelling, or that of a synonym, is to the word."""
    likeness = dict.fromkeys(concepts, 0.0)
    for known in words_for(concepts):
        concept = SYNONYMS.get(known, known)
        likeness[concept] = max(likeness[concept], SequenceMatcher(None, word, known).ratio())
    return tuple(sorted(likeness, key=lambda concept: -likeness[concept]))
