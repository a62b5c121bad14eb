"""Says how often something may fail at most, given how often it failed in some runs."""

from __future__ import annotations

import math

CONFIDENCE = 0.95
_STEPS = 60
_DIGITS = 3


def failure_below(runs: int, wrong: int = 0) -> float:
    """Returns the share of runs below which failures lie at 95 % confidence (exact, one-sided binomial).

    With no wrong run it is 1 - 0.05 ** (1 / runs). The runs must be independent, and like those that follow.
    Raises ValueError for impossible numbers.
    """
    if not 0 <= wrong <= runs:
        raise ValueError(f"{wrong} of {runs} runs cannot be wrong")
    if wrong == runs:
        return 1.0
    if wrong == 0:
        return float(1.0 - (1.0 - CONFIDENCE) ** (1.0 / runs))
    low, high = wrong / runs, 1.0
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if _at_most(wrong, runs, middle) > 1.0 - CONFIDENCE else (low, middle)
    return high


def told(runs: int, wrong: int = 0) -> str:
    """Formats that share, rounded up: "< 45.1 %"; "" without runs."""
    if runs == 0:
        return ""
    percent = 100.0 * failure_below(runs, wrong)
    step = 10.0 ** (math.floor(math.log10(percent)) + 1 - _DIGITS)
    return f"< {min(math.ceil(percent / step) * step, 100.0):.{_DIGITS}g} %"


def _at_most(wrong: int, runs: int, share: float) -> float:
    """Returns the probability of at most so many wrong runs."""
    if share >= 1.0:
        return 0.0
    logs = (
        math.lgamma(runs + 1)
        - math.lgamma(k + 1)
        - math.lgamma(runs - k + 1)
        + k * math.log(share)
        + (runs - k) * math.log1p(-share)
        for k in range(wrong + 1)
    )
    return math.fsum(math.exp(log) for log in logs)
