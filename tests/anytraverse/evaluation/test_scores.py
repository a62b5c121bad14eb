"""IoU, AUROC and shares, against naive ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from anytraverse.evaluation.scores import Overlap, Ranking, Share

Floats = NDArray[np.float32]

coarse = arrays(np.float32, st.integers(1, 40), elements=st.integers(0, 256).map(lambda step: step / 256))
any_floats = arrays(np.float32, st.integers(1, 40), elements=st.floats(0, 1, width=32))
masks = arrays(np.bool_, (4, 5))


def naive_auroc(positive: Floats, negative: Floats) -> float:
    """The share of pairs that are won, equal ones counting half."""
    high, low = positive[:, None], negative[None, :]
    return float(((high > low) + 0.5 * (high == low)).mean())


def bounds(positive: Floats, negative: Floats, near: float) -> tuple[float, float]:
    """The same with all pairs lost, and with all pairs won, that are nearly equal."""
    high, low = positive[:, None].astype(np.float64), negative[None, :].astype(np.float64)
    aside = np.minimum(np.minimum(high, low), np.minimum(1 - high, 1 - low))
    width = near * aside + float(np.finfo(np.float32).tiny)
    return float((high - low > width).mean()), float((high - low >= -width).mean())


def ranked(positive: Floats, negative: Floats) -> Ranking:
    ranking = Ranking()
    ranking.add(positive, negative)
    return ranking


@settings(max_examples=40)
@given(coarse, coarse)
def test_auroc_with_ties_is_the_naive_one(positive: Floats, negative: Floats) -> None:
    assert ranked(positive, negative).auroc == pytest.approx(naive_auroc(positive, negative), abs=1e-12)


@settings(max_examples=40)
@given(any_floats, any_floats)
def test_auroc_of_any_scores_differs_only_by_nearly_equal_ones(positive: Floats, negative: Floats) -> None:
    low, high = bounds(positive, negative, near=1e-3)
    auroc = ranked(positive, negative).auroc
    assert auroc is not None
    assert low - 1e-12 <= auroc <= high + 1e-12


@settings(max_examples=15)
@given(st.lists(st.tuples(coarse, coarse), min_size=1, max_size=4))
def test_auroc_does_not_depend_on_the_pictures_that_the_pixels_come_from(
    parts: list[tuple[Floats, Floats]],
) -> None:
    apart = Ranking()
    for positive, negative in parts:
        apart.add(positive, negative)
    at_once = ranked(np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts]))
    assert apart.auroc == at_once.auroc
    assert (apart.positives, apart.negatives) == (at_once.positives, at_once.negatives)


@pytest.mark.parametrize(
    ("smaller", "larger"),
    [(1e-30, 2e-30), (1e-6, 1.01e-6), (1 - 1e-5, 1 - 0.99e-5), (0.499, 0.5), (0.5, 0.501)],
)
def test_scores_near_0_and_near_1_keep_their_order(smaller: float, larger: float) -> None:
    low, high = np.array([smaller], dtype=np.float32), np.array([larger], dtype=np.float32)
    assert ranked(high, low).auroc == 1.0
    assert ranked(low, high).auroc == 0.0


def test_zero_and_minus_zero_are_equal() -> None:
    assert ranked(np.array([-0.0], dtype=np.float32), np.zeros(1, dtype=np.float32)).auroc == 0.5


def test_auroc_of_millions_of_pixels_keeps_to_its_memory() -> None:
    values = np.linspace(0, 1, 1_000_000, dtype=np.float32)
    ranking = Ranking()
    for _ in range(3):
        ranking.add(values, values**2)
    assert ranking.positives == ranking.negatives == 3_000_000
    assert ranking.auroc == pytest.approx(2 / 3, abs=1e-4)  # P(x > y^2) = E[sqrt(x)]
    assert sum(counts.nbytes for counts in vars(ranking).values()) < 5_000_000


def test_auroc_of_one_kind_alone_is_none() -> None:
    some, none = np.ones(3, dtype=np.float32), np.zeros(0, dtype=np.float32)
    assert ranked(some, none).auroc is None
    assert ranked(none, some).auroc is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -0.01, 1.01])
def test_scores_outside_0_to_1_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="0 to 1"):
        ranked(np.array([0.5, bad], dtype=np.float32), np.zeros(1, dtype=np.float32))


@pytest.mark.slow
@given(st.lists(st.tuples(masks, masks, masks), min_size=1, max_size=4))
def test_iou_is_the_naive_one_pooled_and_by_picture(
    pictures: list[tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]],
) -> None:
    overlap, each, both, either = Overlap(), [], 0, 0
    for number, (found, truth, counted) in enumerate(pictures):
        overlap.add(number, found, truth, counted)
        cells = list(zip(found.flat, truth.flat, counted.flat, strict=True))
        own = sum(bool(f and t and c) for f, t, c in cells), sum(bool((f or t) and c) for f, t, c in cells)
        both, either = both + own[0], either + own[1]
        if own[1]:
            each.append(own[0] / own[1])
    assert overlap.pooled == (both / either if either else None)
    assert overlap.mean == (pytest.approx(sum(each) / len(each)) if each else None)


def test_the_worst_pictures_come_first() -> None:
    overlap, ones = Overlap(), np.ones((1, 4), dtype=np.bool_)
    for number, cells in ((7, 3), (8, 1), (9, 4)):
        found = np.arange(4)[None, :] < cells
        overlap.add(number, found, ones, ones)
    assert overlap.worst(2) == [(8, 0.25), (7, 0.75)]


def test_a_share_counts_what_is_above_and_what_is_not_known() -> None:
    share = Share(0.5)
    assert share.value is None
    share.add(np.array([0.5, 0.51], dtype=np.float32))
    share.add(np.array([0.1, math.nan], dtype=np.float32))
    assert share.value == 0.5
