"""Figures with their counts and 95 % confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Z = 1.959964
_RESAMPLES = 1000


@dataclass(frozen=True)
class Figure:
    """Holds a figure, its 95 % confidence interval, and of how many it is. None where nothing was counted.

    count: of `of`, how many; None for a figure that is no share.
    """

    value: float | None
    low: float | None
    high: float | None
    of: int
    count: int | None = None

    def __str__(self) -> str:
        if self.value is None or self.low is None or self.high is None:
            return "not measured (0)"
        counted = f"{self.count}/{self.of}" if self.count is not None else f"n {self.of}"
        return f"{_short(self.value)} [{_short(self.low)}, {_short(self.high)}] ({counted})"

    @property
    def brief(self) -> str:
        """The figure without its interval."""
        return "-" if self.value is None else f"{_short(self.value)} ({self.count}/{self.of})"

    @property
    def rounded(self) -> float | None:
        """The value with three digits, as the JSON line has it."""
        return None if self.value is None else round(self.value, 3)

    def as_json(self) -> dict[str, Any]:
        """Return the figure for the results' file."""
        interval = (
            None if self.low is None or self.high is None else [round(self.low, 3), round(self.high, 3)]
        )
        return {"value": self.rounded, "ci95": interval, "of": self.of, "count": self.count}


def share(hits: Sequence[bool]) -> Figure:
    """Count the hits, with the interval of Wilson (1927)."""
    count, of = sum(map(bool, hits)), len(hits)
    return Figure(count / of, *_wilson(count / of, of), of, count) if of else Figure(None, None, None, 0, 0)


def share_of_tries(tries: Sequence[Sequence[bool]]) -> Figure:
    """Calculate the mean share of hits in each frame's tries; the interval is as if each had one try."""
    of = len(tries)
    if not of:
        return Figure(None, None, None, 0)
    rate = float(np.mean([np.mean(one) for one in tries]))
    return Figure(rate, *_wilson(rate, of), of)


def _wilson(rate: float, of: int) -> tuple[float, float]:
    spread = _Z**2 / of
    middle = (rate + spread / 2) / (1 + spread)
    half = _Z / (1 + spread) * math.sqrt(rate * (1 - rate) / of + spread / (4 * of))
    return max(0.0, middle - half), min(1.0, middle + half)


def pooled(parts: Sequence[tuple[int, int]], seed: int = 0) -> Figure:
    """Sum (numerator, denominator) over frames and divide; the interval is by bootstrap over frames."""
    return together([parts], seed)


def together(sets: Sequence[Sequence[tuple[int, int]]], seed: int = 0) -> Figure:
    """Calculate the mean over sets of their `pooled` figures; each set's frames are drawn again by itself.

    Sets without a denominator are left out.
    """
    tables = [np.asarray(parts, dtype=np.float64).reshape(-1, 2) for parts in sets]
    tables = [table for table in tables if table[:, 1].sum() > 0]
    if not tables:
        return Figure(None, None, None, 0)
    rng = np.random.default_rng([seed, 95])
    drawn = np.mean([_resampled(table, rng) for table in tables], axis=0)
    low, high = np.quantile(drawn, (0.025, 0.975))
    value = float(np.mean([table[:, 0].sum() / table[:, 1].sum() for table in tables]))
    return Figure(value, float(low), float(high), sum(map(len, tables)))


def _resampled(table: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    sums = table[rng.integers(0, len(table), (_RESAMPLES, len(table)))].sum(axis=1)
    return np.asarray(sums[:, 0] / np.maximum(sums[:, 1], 1e-9))


def _short(value: float) -> str:
    text = f"{value:.3f}"
    return text[1:] if text.startswith("0.") else text
