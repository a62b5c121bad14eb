"""Measures how similar a frame must be to one of many remembered scenes to count as the same place.

A frame of another place is compared with every remembered scene, and the most similar one counts. So with a
fixed threshold the more foreign frames match, the more is remembered (open-set identification: Phillips,
Grother and Micheals, Evaluation Methods in Face Recognition, 2011). Here the threshold follows the number of
scenes, so that the share of foreign frames that match ANY of them stays at a stated rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.labels import DatasetError
from anytraverse.judging import Thresholds
from anytraverse.perception import DefaultThresholds

RATES: Mapping[int, float] = {1: 0.05, 4: 0.05, 16: 0.05, 40: 0.05, 64: 0.05, 256: 0.10}
"""Number of remembered scenes -> the share of foreign frames that may match any of them."""
DRAWS = 200
"""Memories that are drawn for each number of scenes."""
_SMALLEST = np.finfo(np.float32).eps

Embeddings = NDArray[np.float32]
"""(n, d), one unit-norm row a frame."""


@dataclass(frozen=True, eq=False)
class Places:
    """Holds the embeddings of frames of places that are remembered, seen again, and never seen before.

    remembered: (n, d), from which memories are drawn; rows of one place may all be in it. again: (p, d),
    frames of remembered places, seen another time. same: (p,) int, the row of `remembered` that shows the
    place of each. foreign: (f, d), frames of places of which no row of `remembered` is.
    Raises DatasetError for other shapes, values that are not finite, or no foreign frame.
    """

    remembered: Embeddings
    again: Embeddings
    same: NDArray[np.intp]
    foreign: Embeddings

    def __post_init__(self) -> None:
        size = self.remembered.shape[-1]
        rows = (self.remembered, self.again, self.foreign)
        if any(one.ndim != 2 or one.shape[1] != size or not np.isfinite(one).all() for one in rows):
            raise DatasetError("embeddings must be finite rows of one length: check what made them")
        if not all(len(one) for one in rows):
            raise DatasetError("there are no frames that are remembered, seen again, or foreign: name some")
        if (
            self.same.shape != (len(self.again),)
            or not ((self.same >= 0) & (self.same < len(self.remembered))).all()
        ):
            raise DatasetError("each frame seen again needs the row of the remembered one of its place")


@dataclass(frozen=True)
class Matching:
    """Holds what a threshold gives for one number of remembered scenes.

    false: share of foreign frames that match any scene, over all drawn memories. recall: share of frames seen
    again that match the scene of their place. foreign, again: how many frames there were of each.
    """

    scenes: int
    threshold: float
    false: float
    recall: float
    foreign: int
    again: int


def fitted_match(
    places: Places, rates: Mapping[int, float] = RATES, *, draws: int = DRAWS, seed: int = 0
) -> tuple[tuple[int, float], ...]:
    """Fit the least cosine of a match for each number of scenes: `DefaultThresholds.match`.

    Raises DatasetError when fewer frames are remembered than a memory needs.
    """
    nearest = _nearest(places, sorted(rates), draws, seed)
    table: list[tuple[int, float]] = []
    for scenes, cosines in nearest.items():
        ordered = np.sort(cosines, axis=None)
        allowed = int(rates[scenes] * len(ordered))
        # just above the most similar foreign frame that must not match
        least = float(ordered[-1 - allowed]) + float(_SMALLEST)
        table.append((scenes, min(1.0, max([least, *(row[1] for row in table[-1:])]))))
    return tuple(table)


def measured_match(
    places: Places,
    thresholds: DefaultThresholds,
    scenes: Sequence[int] = tuple(RATES),
    *,
    draws: int = DRAWS,
    seed: int = 0,
) -> tuple[Matching, ...]:
    """Measure the thresholds that the engine uses, on other frames than those that they were fitted to.

    Raises DatasetError when fewer frames are remembered than a memory needs.
    """
    limits = Thresholds.of(thresholds)
    own = np.einsum("pd,pd->p", places.again, places.remembered[places.same])
    found = []
    for number, cosines in _nearest(places, sorted(scenes), draws, seed).items():
        least = limits.least_match(number)
        false, recall = float((cosines >= least).mean()), float((own >= least).mean())
        found.append(Matching(number, least, false, recall, len(places.foreign), len(places.again)))
    return tuple(found)


def _nearest(places: Places, scenes: Sequence[int], draws: int, seed: int) -> dict[int, NDArray[np.float32]]:
    """For each number of scenes: the cosine of each foreign frame to the nearest of a memory, (draws, f).

    A larger memory of one draw contains the smaller ones.
    """
    if not scenes or scenes[0] < 1 or scenes[-1] > len(places.remembered):
        raise DatasetError(
            f"a memory of {scenes[-1] if scenes else 0} scenes cannot be drawn from {len(places.remembered)} "
            "frames: give more frames, or measure fewer scenes"
        )
    rng = np.random.default_rng(seed)
    every = places.foreign @ places.remembered.T
    nearest = {number: np.empty((draws, len(every)), np.float32) for number in scenes}
    for draw in range(draws):
        order = rng.permutation(len(places.remembered))
        for number in scenes:
            nearest[number][draw] = every[:, order[:number]].max(axis=1)
    return nearest
