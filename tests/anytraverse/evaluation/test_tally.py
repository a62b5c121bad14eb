"""Tallies: every figure that is made of them is the one that the maps themselves give."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Maps
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.labels import DatasetError, LabelClasses
from anytraverse.evaluation.scores import COARSE, FINE, Bins, Ranking, area
from anytraverse.evaluation.seeing import TimedMaps
from anytraverse.evaluation.summary import TallySummary
from anytraverse.evaluation.tally import THRESHOLDS, DamagedTallyError, Rows, Tally

CLASSES = LabelClasses(("void", "grass", "", "bush", "Grass", "drum"), ignore=0)
ROWS = Rows(CLASSES)
IDS = (0, 1, 3, 4, 5)


def a_frame(seed: int, ids: tuple[int, ...] = IDS) -> tuple[LabelledFrame, TimedMaps]:
    chance = np.random.default_rng(seed)
    shape = 6, 7
    values = (chance.integers(0, 41, (2, *shape)) / 40).astype(np.float32)
    labels = chance.choice(ids, shape).astype(np.uint8)
    drivable, named = values[0] > 0.7, np.zeros(1, dtype=np.bool_)
    maps = Maps(values[None, 0], values[0], values[1], values[1], drivable, named, values[1] <= 0.5)
    return LabelledFrame(seed, f"{seed}.jpg", np.zeros((*shape, 3), np.uint8), labels), TimedMaps(maps, 1.5)


def summed(frames: list[tuple[LabelledFrame, TimedMaps]]) -> TallySummary:
    summary = TallySummary(ROWS, ["grass"], ["drum"])
    for frame, seen in frames:
        tally = Tally.of(seen, frame, ROWS)
        again = Tally.unpacked(tally.packed(), ROWS.count)
        summary.add(frame.number, frame.name, again)
    return summary


def iou(found: np.ndarray, truth: np.ndarray) -> float:
    return float((found & truth).sum() / (found | truth).sum())


@settings(max_examples=30)
@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=4, unique=True))
def test_figures_are_those_of_the_maps(seeds: list[int]) -> None:
    frames = [a_frame(seed) for seed in seeds]
    summary = summed(frames)
    figures = summary.figures(1)
    trav = np.stack([seen.maps.traversability for _, seen in frames])
    drivable = np.stack([seen.maps.drivable for _, seen in frames])
    uncertainty = np.stack([seen.maps.uncertainty for _, seen in frames])
    labels = np.stack([frame.labels for frame, _ in frames])
    truth, counted = np.isin(labels, (1, 4)), labels != 0
    for row, threshold in zip(figures["curve"], THRESHOLDS, strict=True):
        found = trav > np.float32(threshold)
        pairs = list(zip(found, truth, counted, strict=True))
        assert row["iou_pooled"] == pytest.approx(iou(found & counted, truth), abs=1e-4)
        assert row["iou_mean"] == pytest.approx(np.mean([iou(f & c, t) for f, t, c in pairs]), abs=1e-4)
        assert row["iou_authors"] == pytest.approx(np.mean([iou(f, t) for f, t, _ in pairs]), abs=1e-4)
        assert row["recall"] == pytest.approx((found & truth).sum() / truth.sum(), abs=1e-4)
    half = trav > 0.5
    assert figures["iou_mean"] == figures["curve"][9]["iou_mean"]
    assert figures["iou_known_pooled"] == pytest.approx(iou(drivable & counted, truth), abs=1e-4)
    assert figures["classes"]["grass"]["recall"] == pytest.approx(half[truth].mean(), abs=1e-4)
    assert figures["classes"]["bush"]["recall"] == pytest.approx((~half[labels == 3]).mean(), abs=1e-4)
    exact = Ranking()
    exact.add(uncertainty[labels == 5], uncertainty[truth])
    assert figures["auroc"] == pytest.approx(exact.auroc, abs=0.01)
    assert figures["drivable_above_half"] == pytest.approx((uncertainty[truth] > 0.5).mean(), abs=1e-4)
    score = summary.frames[0]
    assert score.wrong == pytest.approx((half[0] & ~truth[0] & counted[0]).sum() / counted[0].sum())
    assert score.missed == pytest.approx((~half[0] & truth[0]).sum() / counted[0].sum())
    assert score.found == pytest.approx((half[0] & counted[0]).sum() / counted[0].sum())


def test_nothing_drivable_at_all_is_refused() -> None:
    frame, seen = a_frame(1, ids=(3,))
    seen.maps.signed[:] = 0
    with pytest.raises(DatasetError, match="no pixel is labelled drivable or found so"):
        summed([(frame, seen)]).figures(1)


def test_a_frame_with_nothing_drivable_has_no_iou_and_the_others_count() -> None:
    empty, nothing = a_frame(1, ids=(3, 0))
    nothing.maps.signed[:] = 0
    summary = summed([(empty, nothing), a_frame(2)])
    assert [frame.iou is None for frame in summary.frames] == [True, False]
    assert summary.figures(5)["iou_mean"] == pytest.approx(summary.frames[1].iou, abs=1e-4)
    assert len(summary.best(5)) == 1
    assert summary.frames_csv().splitlines()[1].startswith("1,1.jpg,,,")


def test_a_summary_without_unknown_classes_has_no_auroc() -> None:
    summary = TallySummary(ROWS, ["grass"], [])
    frame, seen = a_frame(3)
    summary.add(0, "a", Tally.of(seen, frame, ROWS))
    figures = summary.figures(1)
    assert (figures["auroc"], figures["unknown"], figures["unknown_above_half"]) == (None, {}, None)


@pytest.mark.parametrize("cut", [0, 10, 60])
def test_a_tally_that_is_not_whole_is_refused(cut: int) -> None:
    frame, seen = a_frame(4)
    packed = Tally.of(seen, frame, ROWS).packed()
    for damaged in (packed[:cut], b"x" + packed):
        with pytest.raises(DamagedTallyError, match="damaged"):
            Tally.unpacked(damaged, ROWS.count)
    with pytest.raises(DamagedTallyError, match="damaged"):
        Tally.unpacked(packed, ROWS.count + 1)


@given(st.lists(st.floats(0, 1, width=32), min_size=2), st.sampled_from([FINE, COARSE]))
def test_bins_keep_the_order_and_the_half(values: list[float], bins: Bins) -> None:
    scores = np.sort(np.array(values, dtype=np.float32))
    places = bins.of(scores)
    assert (np.diff(places) >= 0).all()
    assert ((places > bins.half) == (scores > 0.5)).all()
    assert 0 <= places.min() <= places.max() < bins.count


def test_the_area_of_nothing_is_none() -> None:
    none, one = np.zeros(3, dtype=np.int64), np.array([0, 1, 0], dtype=np.int64)
    assert area(none, one) is None
    assert area(one, none) is None
    assert area(one, one) == 0.5
