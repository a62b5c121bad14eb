"""The network's classes, and which of them the labels of a folder mean."""

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
"""In the order of the logits. The last one is whatever has no name: it is trained on pasted things."""

UNKNOWN = CLASSES.index("unknown")
DRIVABLE = (0, 1, 2)
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
"""Other labels teach nothing. "obstacle" is among them because in the frames that this was made with it is
noise: a label of your own that means things in the way is best called "thing"."""


def class_of(label: str) -> int | None:
    """The class that a folder's label means, or None: it teaches nothing."""
    name = fold(label)
    for index, own in enumerate(CLASSES):
        if name == own or name in _LABELS[own]:
            return index
    return None


def translation(labels: Sequence[str]) -> NDArray[np.uint8]:
    """Label id -> class, (256,); `UNLABELLED` where a label teaches nothing."""
    table = np.full(256, UNLABELLED, dtype=np.uint8)
    for index, label in enumerate(labels):
        found = class_of(label)
        table[index] = UNLABELLED if found is None else found
    return table
