"""Compares results with earlier ones: what became worse by more than the spread of both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from bench.result import RAN, BenchResult, MeasuredFigure, points_of

WORSE, BETTER, ALIKE, UNKNOWN = "worse", "better", "within the spread", "spread not known"
RUN_TO_RUN = 0.15
"""Share by which a figure may differ whatever its spread, which is that of one run. Another one of the same
code, half an hour later, differed by up to 12 % beyond the quartiles of both."""
_FEW = 12
"""Points that a line has at most where each is a figure to compare; more are samples over time."""
_LIKE_FOR_LIKE = ("cpu", "cores", "architecture")


class Change(NamedTuple):
    """How a figure differs from the earlier one. share: of it, None where that was 0."""

    name: str
    what: str
    before: MeasuredFigure
    now: MeasuredFigure
    verdict: str
    share: float | None


def changes(results: Mapping[str, BenchResult], earlier: Mapping[str, BenchResult]) -> Iterator[Change]:
    """Yields the figures that both have and of which less or more is better, by the same command."""
    for name, result in results.items():
        before = earlier.get(name)
        if before is None or {before.state, result.state} != {RAN} or before.command != result.command:
            continue
        known = _figures(before)
        for what, now in _figures(result).items():
            old = known.get(what)
            if old is not None and now.better and old.unit == now.unit:
                share = now.value / old.value - 1 if old.value else None
                yield Change(name, what, old, now, _verdict(old, now), share)


def _figures(result: BenchResult) -> dict[str, MeasuredFigure]:
    """Returns the figures, and the points of the series but for samples over time."""
    return {**result.figures, **dict(points_of(result.series, _FEW))}


def _verdict(before: MeasuredFigure, now: MeasuredFigure) -> str:
    if before.spread is None or now.spread is None:
        return ALIKE if before.value == now.value else UNKNOWN
    if abs(now.value - before.value) <= RUN_TO_RUN * abs(before.value):
        return ALIKE
    if now.spread[0] > before.spread[1]:
        return WORSE if now.better == "less" else BETTER
    if now.spread[1] < before.spread[0]:
        return BETTER if now.better == "less" else WORSE
    return ALIKE


def other_machine(results: Mapping[str, BenchResult], earlier: Mapping[str, BenchResult]) -> str:
    """Says in what the machines differ that made these results; "" where they are alike."""
    told = []
    for key in _LIKE_FOR_LIKE:
        now = {str(one.run.get(key)) for one in results.values()}
        before = {str(one.run.get(key)) for name, one in earlier.items() if name in results}
        if before and now != before:
            told.append(f"{key} {', '.join(sorted(now))}, before {', '.join(sorted(before))}")
    return "; ".join(told)
