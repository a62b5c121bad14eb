"""Computes medians, their spread, and how many times faster one contestant is than another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spread:
    """Median and quartiles."""

    median: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        return f"{self.median:{spec}} [{self.low:{spec}}, {self.high:{spec}}]"

    def times(self, factor: float) -> Spread:
        return Spread(self.median * factor, self.low * factor, self.high * factor)


def spread(values: Sequence[float]) -> Spread:
    """Computes median and quartiles. Raises ValueError without values."""
    if not values:
        raise ValueError("no values to take a median of")
    low, median, high = np.percentile(values, [25, 50, 75])
    return Spread(float(median), float(low), float(high))


def ratio(slower: Sequence[float], faster: Sequence[float]) -> Spread:
    """Computes how many times less the second took, by pairs of a round. ValueError if one is missing."""
    return spread([one / other for one, other in zip(slower, faster, strict=True)])
