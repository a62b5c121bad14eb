"""Calculates attention from class scores; what belongs to no class asked for stays uncertain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.regions import Box

Array = NDArray[np.float32]

_LEAST_PLACES = 4
_LEAST_GAP = 0.01
"""Difference of cosines by which a thing must stand out from the rest of its frame."""


def attention_of(values: Array, asked: Sequence[int], shares: bool) -> Array:
    """Calculate the attention of the asked classes, (len(asked), h, w) in [0, 1], from values (n, h, w).

    asked: indices of classes. shares: whether the values of all classes sum to 1 (softmax).
    A softmax assigns every place to some class, also a place that belongs to none. Let K be the sum of the
    asked classes' shares. A class's attention is K times its share over the largest share asked for. So
    1 - max is 1 - K: ground of other classes is uncertain, and so is ground on which the network is undecided
    between asked and other classes.
    Without shares (sigmoid), a class's attention is its value.
    """
    if not asked or not shares:
        return values[list(asked)]
    distinct = values[sorted(set(asked))]
    known = np.minimum(distinct.sum(axis=0), 1.0)
    known /= np.maximum(distinct.max(axis=0), np.finfo(np.float32).tiny)
    attention: Array = np.minimum(values[list(asked)] * known, 1.0)
    return attention


def learn(directions: Array, box: Box) -> Array:
    """Learn what a tapped box shows, (d + 2,): its mean direction, and two levels.

    directions: (d, h, w), see `Segmented.directions`. The levels are the mean cosines to that direction, of
    the box and of the rest of the frame. Raises ExampleError for a box that is too small, covers the frame,
    or looks like the rest of it.
    """
    inside = box.mask(*directions.shape[1:])
    if inside.sum() < _LEAST_PLACES or inside.all():
        problem = "covers the whole picture" if inside.all() else "is too small to learn from"
        raise ExampleError(f"the box {problem}: draw one around the thing")
    vector = directions[:, inside].mean(axis=1)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise ExampleError("the network's features are empty there: tap another part of the thing")
    vector /= length
    cosines = np.tensordot(vector, directions, axes=1)
    own, around = float(cosines[inside].mean()), float(cosines[~inside].mean())
    if own - around < _LEAST_GAP:
        raise ExampleError(
            "to this network the box looks like the rest of the picture: draw it closer around the thing"
        )
    return np.array([*vector, own, around], dtype=np.float32)


def likeness(directions: Array, example: Array) -> Array:
    """Calculate the attention of an example, (h, w) in [0, 1]: 1 at its box's level, 0 at that of the rest.

    Raises ExampleError for an example of another length.
    """
    if len(example) != len(directions) + 2:
        raise ExampleError("this example is not whole: tap the thing again")
    own, around = float(example[-2]), float(example[-1])
    cosines = np.tensordot(example[:-2], directions, axes=1)
    rising = (cosines - around) / max(own - around, _LEAST_GAP)
    return np.asarray(np.clip(rising, 0.0, 1.0), dtype=np.float32)


def resized_to(plane: Array, shape: tuple[int, int]) -> Array:
    """Resize a map, (h, w), by nearest neighbour."""
    rows, columns = (
        np.minimum(((np.arange(wanted) + 0.5) * given / wanted).astype(np.intp), given - 1)
        for wanted, given in zip(shape, plane.shape, strict=True)
    )
    resized: Array = plane[rows[:, None], columns]
    return resized
