"""Scores maps against labels, picture by picture in bounded memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Values = NDArray[np.floating[Any]]

Counts = NDArray[np.int64]

_HALF = int(np.float32(0.5).view(np.uint32))


@dataclass(frozen=True)
class Bins:
    """Sorts scores in [0, 1] into bins whose order is that of the scores.

    dropped: low bits of a float32 that do not count: scores that differ only in these share a bin, so that a
    bin's width is 2 ** (dropped - 23) of its distance to the nearer of 0 and 1. Small attentions and
    uncertainties near 1 thereby keep their order.
    """

    dropped: int

    @property
    def count(self) -> int:
        """The number of bins."""
        return 2 * self.half + 1

    @property
    def half(self) -> int:
        """The last bin of scores that are not above 0.5."""
        return _HALF >> self.dropped

    def of(self, values: Values) -> Counts:
        """Return the bin of each value, in the shape of `values`. ValueError outside [0, 1] and for NaN."""
        scores = np.asarray(values, dtype=np.float32)
        if scores.size and not (scores.min() >= 0.0 and scores.max() <= 1.0):
            raise ValueError("scores must lie in 0 to 1")
        # The bits of floats above 0, read as integers, have the order of the floats. Above 0.5 the bits of
        # 1 - x are used, which float32 holds exactly.
        upper = scores > 0.5
        aside = np.where(upper, np.float32(1.0) - scores, scores) + np.float32(0.0)  # -0.0 becomes 0.0
        bins = (aside.view(np.uint32) >> self.dropped).astype(np.int64)
        return np.where(upper, self.count - 1 - bins, bins)


FINE = Bins(13)
"""A quarter of a million bins; one is a thousandth of its distance wide."""
COARSE = Bins(19)
"""4033 bins; one is a sixteenth of its distance wide."""


def area(positive: Counts, negative: Counts) -> float | None:
    """Return the area under the ROC curve of counts in bins of rising scores, [0, 1], 0.5 by chance.

    It is the share of pairs (positive, negative) in which the positive scores higher; those of one bin count
    half. None where one of the two kinds has no pixel.
    """
    pairs = int(positive.sum()) * int(negative.sum())
    if not pairs:
        return None
    below = np.cumsum(negative) - negative
    return float(np.dot(positive.astype(np.float64), below + 0.5 * negative) / pairs)


@dataclass
class Overlap:
    """Calculates the intersection over union of two masks, for each picture and over all pixels together."""

    intersection: int = 0
    union: int = 0
    pictures: dict[int, float] = field(default_factory=dict)

    def add(self, number: int, found: Mask, truth: Mask, counted: Mask) -> None:
        """Add picture `number`: `found` against `truth` where `counted`, (h, w) each.

        A picture in which both masks are empty has no IoU of its own.
        """
        both = int(np.count_nonzero(found & truth & counted))
        either = int(np.count_nonzero((found | truth) & counted))
        self.intersection += both
        self.union += either
        if either:
            self.pictures[number] = both / either

    @property
    def pooled(self) -> float | None:
        """IoU over all pixels, [0, 1]; None without any."""
        return self.intersection / self.union if self.union else None

    @property
    def mean(self) -> float | None:
        """Mean of the pictures' IoU, [0, 1]; None without any."""
        return math.fsum(self.pictures.values()) / len(self.pictures) if self.pictures else None

    def worst(self, most: int) -> list[tuple[int, float]]:
        """Return number and IoU of the worst pictures, the worst first."""
        return sorted(self.pictures.items(), key=lambda picture: picture[1])[:most]


class Ranking:
    """Calculates the area under the ROC curve of scores in [0, 1], for any number of pixels, in about 4 MB.

    Scores are counted in the bins of `FINE`, and those of one bin count as equal.
    """

    def __init__(self) -> None:
        self._positive: Counts = np.zeros(FINE.count, dtype=np.int64)
        self._negative: Counts = np.zeros(FINE.count, dtype=np.int64)

    def add(self, positive: Values, negative: Values) -> None:
        """Add scores of pixels that should, and that should not, be high. ValueError outside [0, 1]."""
        self._positive += np.bincount(FINE.of(positive).ravel(), minlength=FINE.count)
        self._negative += np.bincount(FINE.of(negative).ravel(), minlength=FINE.count)

    @property
    def positives(self) -> int:
        """The number of pixels that should score high."""
        return int(self._positive.sum())

    @property
    def negatives(self) -> int:
        """The number of pixels that should not score high."""
        return int(self._negative.sum())

    @property
    def auroc(self) -> float | None:
        """As `area` says."""
        return area(self._positive, self._negative)


@dataclass
class Share:
    """Counts how many values are above a level."""

    level: float
    above: int = 0
    total: int = 0

    def add(self, values: Values) -> None:
        """Add values. NaN counts as above, since an unknown value must not improve the score."""
        self.total += values.size
        self.above += values.size - int(np.count_nonzero(values <= self.level))

    @property
    def value(self) -> float | None:
        """The share, [0, 1]; None without any value."""
        return self.above / self.total if self.total else None


@dataclass
class Mean:
    """Calculates the mean of values."""

    sum: float = 0.0
    total: int = 0

    def add(self, values: Values) -> None:
        """Add values."""
        self.sum += float(values.sum(dtype=np.float64))
        self.total += values.size

    @property
    def value(self) -> float | None:
        """The mean; None without any value."""
        return self.sum / self.total if self.total else None
