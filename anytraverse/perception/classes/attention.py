"""How much each place shows what is asked for, so that what nobody asked about stays uncertain."""

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
    """Attention of the asked classes, (len(asked), h, w) in [0, 1], from all classes' values, (n, h, w).

    A softmax gives every place to some class, also what belongs to none, and leaves only the shares of the
    classes to tell. With K the sum of the asked classes' shares, a class's attention is K times its share
    relative to the largest asked one: 1 - max is 1 - K, so ground of classes that nobody asked for, and
    ground on which the network is torn between those and others, is uncertain.
    Classes that share nothing (sigmoid) stand each for itself.
    """
    if not asked or not shares:
        return values[list(asked)]
    distinct = values[sorted(set(asked))]
    known = np.minimum(distinct.sum(axis=0), 1.0)
    known /= np.maximum(distinct.max(axis=0), np.finfo(np.float32).tiny)
    attention: Array = np.minimum(values[list(asked)] * known, 1.0)
    return attention


def learn(directions: Array, box: Box) -> Array:
    """What a tapped box shows, (d + 2,): its mean direction, of `Segmented.directions`, and two levels.

    The levels are the mean cosines to that direction of the box itself and of the rest of the frame.
    Raises ExampleError for a box that is too small, covers all, or shows what is everywhere.
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
    """Attention of an example, (h, w) in [0, 1]: 1 at its own level, 0 at that of what was around it."""
    if len(example) != len(directions) + 2:
        raise ExampleError("this example is not whole: tap the thing again")
    own, around = float(example[-2]), float(example[-1])
    cosines = np.tensordot(example[:-2], directions, axes=1)
    rising = (cosines - around) / max(own - around, _LEAST_GAP)
    return np.asarray(np.clip(rising, 0.0, 1.0), dtype=np.float32)


def resized_to(plane: Array, shape: tuple[int, int]) -> Array:
    """A map, (h, w), brought to another shape by its nearest places."""
    rows, columns = (
        np.minimum(((np.arange(wanted) + 0.5) * given / wanted).astype(np.intp), given - 1)
        for wanted, given in zip(shape, plane.shape, strict=True)
    )
    resized: Array = plane[rows[:, None], columns]
    return resized
