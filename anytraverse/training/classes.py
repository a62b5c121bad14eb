"""Defines the network's classes, and maps the labels of a folder to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.labels import fold

CLASSES = (
    "smooth trail",
    "rough trail",
    "grass",
    "low vegetation",
    "high vegetation",
    "sky",
    "water",
    "unknown",
)
"""In the order of the logits. The last one is for things without a name: it is trained on pasted things."""

UNKNOWN = CLASSES.index("unknown")
DRIVABLE = (0, 1, 2)
GROUND = (*DRIVABLE, CLASSES.index("low vegetation"))
"""What may lie below a thing."""
UNLABELLED = 255

_LABELS: dict[str, tuple[str, ...]] = {
    "smooth trail": (
        "trail", "path", "track", "dirt path", "dirt", "gravel", "road", "asphalt", "concrete", "sand",
    ),
    "rough trail": ("rough path", "mud", "mulch", "rubble track"),
    "grass": ("meadow", "lawn", "dry grass"),
    "low vegetation": ("bush", "bushes", "shrub", "undergrowth", "plants", "vegetation"),
    "high vegetation": ("tree", "trees", "forest", "woods"),
    "sky": (),
    "water": ("puddle", "pond", "river", "lake"),
    "unknown": (
        "thing", "person", "vehicle", "car", "bicycle", "animal", "drum", "barrel", "rock", "stone", "log",
        "fence", "barrier", "building", "wall", "pole", "sign", "container", "bridge",
    ),
}  # fmt: skip
"""Class -> other labels that mean it. Labels that are not here are ignored. One is "obstacle", which in the
frames of the first training was wrong too often: call your own label for things in the way "thing"."""


def class_of(label: str) -> int | None:
    """Return the class that a folder's label means, or None for a label that is ignored."""
    name = fold(label)
    for index, own in enumerate(CLASSES):
        if name == own or name in _LABELS[own]:
            return index
    return None


def translation(labels: Sequence[str]) -> NDArray[np.uint8]:
    """Make the table label id -> class, (256,) uint8; `UNLABELLED` for a label that is ignored."""
    table = np.full(256, UNLABELLED, dtype=np.uint8)
    for index, label in enumerate(labels):
        found = class_of(label)
        table[index] = UNLABELLED if found is None else found
    return table
