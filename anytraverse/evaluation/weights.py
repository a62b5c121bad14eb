"""Compares many weights of the same words, by attention maps that are kept small."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.datasets import Dataset, LabelledFrame, TornPictureError
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.seeing import PerceiverRun, stretched
from anytraverse.evaluation.tally import HALF, THRESHOLDS
from anytraverse.perception import Perceiver, Prompt
from anytraverse.pooling import weighted_max
from anytraverse.preferences import Preferences

MOST = 10_000
LARGEST = 64
"""Cells of a small map's longer side. A model's coarser maps are enlarged to it, as to the labels' size."""
_LEVELS = np.array(THRESHOLDS, dtype=np.float32)

Signs = tuple[tuple[str, bool], ...]
"""Words, and whether each is drivable: all that the attention depends on."""


class WeightScore(NamedTuple):
    """Holds the figures of a set of weights, as `TallySummary` calculates them of the whole maps.

    iou_mean, iou_pooled: at 0.5. best_iou_mean, best_threshold: the highest mean IoU of all thresholds.
    """

    words: Preferences
    iou_mean: float | None
    iou_pooled: float | None
    best_iou_mean: float | None
    best_threshold: float


def read_weights(text: str) -> list[Preferences]:
    """Read `grass: 0.2,0.6,1; bush: -1`, and return every choice of one weight for each word.

    Raises DatasetError for too many, PreferencesError for words or weights that cannot be used.
    """
    choices: list[list[str]] = []
    count = 1
    for part in filter(str.strip, text.split(";")):
        word, colon, weights = part.rpartition(":")
        if not colon:
            raise DatasetError(f'"{part.strip()}" has no weights: write it as `grass: 0.2,0.6,1`')
        choices.append([f"{word}: {weight}" for weight in weights.split(",")])
        count *= len(choices[-1])
        if count > MOST:
            raise DatasetError(f"more than {MOST} sets of weights: give fewer for some words")
    found = [Preferences.parse("; ".join(one)) for one in product(*choices)]
    return list(dict.fromkeys(found))


@dataclass(frozen=True, eq=False)
class _Small:
    """A frame made small. attention: (n, h, w) uint8, 255 is 1. true, other: labelled pixels of each cell.

    true: of the drivable classes, (h * w,) float64; other: of the others.
    """

    attention: Mapping[Signs, NDArray[np.uint8]]
    true: NDArray[np.float64]
    other: NDArray[np.float64]


class WeightSweep:
    """Scores sets of weights on a data set. A frame is encoded once, whatever the number of sets.

    torn: frames that could not be read.
    """

    def __init__(self, dataset: Dataset, perceiver: Perceiver, drivable: Sequence[str]) -> None:
        self.torn = 0
        self._dataset = dataset
        self._perceiver = perceiver
        self._drivable = drivable

    def scores(self, sets: Sequence[Preferences]) -> list[WeightScore]:
        """Score all sets.

        Raises DatasetError where no frame can be read, PreferencesError, PerceiverError.
        """
        first = {signs_of(words): words for words in reversed(sets)}
        for words in first.values():
            PerceiverRun(self._perceiver, words)  # refuses words that cannot be asked
        signs = list(first)
        sums = np.zeros((len(sets), len(THRESHOLDS)))
        scored, both, either = sums.copy(), sums.copy(), sums.copy()
        frames = 0
        for small in self._frames(signs):
            frames += 1
            for number, words in enumerate(sets):
                right, union = _overlap(small, words)
                both[number] += right
                either[number] += union
                sums[number] += np.divide(right, union, out=np.zeros_like(right), where=union > 0)
                scored[number] += union > 0
        if not frames:
            raise DatasetError(f"{self._dataset.path} has no frame that can be read: copy the folder again")
        return [
            _score(words, *arrays) for words, *arrays in zip(sets, sums, scored, both, either, strict=True)
        ]

    def _frames(self, signs: Sequence[Signs]) -> Iterator[_Small]:
        with Progress(len(self._dataset), "frames") as progress:
            for number in self._dataset.numbers:
                try:
                    frame = self._dataset.read(number)
                except TornPictureError as error:
                    self.torn += 1
                    progress.say(f"{error}, skipped")
                else:
                    yield self._small(frame, signs)
                progress.step()

    def _small(self, frame: LabelledFrame, signs: Sequence[Signs]) -> _Small:
        features = self._perceiver.encode(frame.image)
        made: dict[Signs, NDArray[np.uint8]] = {}
        shape = (1, 1)
        for asked in signs:
            maps = self._perceiver.attend(features, [Prompt(word, drivable=yes) for word, yes in asked])
            shape = small_shape(*maps.shape[1:])
            made[asked] = np.stack([_reduced(one, shape) for one in maps])
        classes = self._dataset.classes
        true, labelled = classes.mask(frame.labels, self._drivable), classes.labelled(frame.labels)
        return _Small(made, _counts(true, shape), _counts(labelled & ~true, shape))


def signs_of(words: Preferences) -> Signs:
    """Return all of a set of weights that the attention depends on."""
    return tuple((word, weight > 0) for word, weight in words.items())


def small_shape(height: int, width: int) -> tuple[int, int]:
    """Return rows and columns of a small map: `LARGEST` on the longer side, in the map's proportions."""
    factor = LARGEST / max(height, width)
    return max(1, round(height * factor)), max(1, round(width * factor))


def _reduced(attention: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.uint8]:
    return np.asarray(np.rint(stretched(attention, shape) * 255.0), np.uint8)


def _counts(mask: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Count the pixels of a mask in each cell, as if each lay evenly in the cells that it touches."""
    share = cv2.resize(mask.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(share, np.float64).ravel() * (mask.size / (shape[0] * shape[1]))


def _overlap(small: _Small, words: Preferences) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return intersection and union over labelled pixels, by threshold."""
    attention = small.attention[signs_of(words)].astype(np.float32) / np.float32(255.0)
    weights = np.asarray(list(words.values()), np.float32)
    level = np.searchsorted(_LEVELS, np.clip(weighted_max(attention, weights), 0.0, 1.0).ravel())
    both, wrong = (
        np.bincount(level, weights=pixels, minlength=len(THRESHOLDS) + 1)[::-1].cumsum()[::-1][1:]
        for pixels in (small.true, small.other)
    )
    return both, small.true.sum() + wrong


def _score(
    words: Preferences,
    sums: NDArray[np.float64],
    scored: NDArray[np.float64],
    both: NDArray[np.float64],
    either: NDArray[np.float64],
) -> WeightScore:
    means = np.divide(sums, scored, out=np.full_like(sums, np.nan), where=scored > 0)
    pooled = both[HALF] / either[HALF] if either[HALF] > 0 else None
    if np.isnan(means).all():
        return WeightScore(words, None, pooled, None, 0.5)
    best = int(np.nanargmax(means))
    half = None if np.isnan(means[HALF]) else float(means[HALF])
    return WeightScore(words, half, pooled, float(means[best]), THRESHOLDS[best])
