from __future__ import annotations

import math
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.sim.field.trail import MIN_RADIUS, Course, Trail

TRAILS = {seed: Trail(seed) for seed in range(1, 21)}


@pytest.mark.parametrize("seed", TRAILS)
def test_a_lap_is_short_closed_and_gently_curved(seed: int) -> None:
    trail = TRAILS[seed]
    assert 120 <= trail.length <= 140
    headings = np.unwrap([trail.pose(s).heading for s in np.arange(0, trail.length + 1, 0.5)])
    assert headings[-3] - headings[0] == pytest.approx(2 * math.pi, abs=0.2)
    assert np.abs(np.diff(headings)).max() / 0.5 <= 1 / (MIN_RADIUS - 0.5)
    begin, end = trail.pose(0), trail.pose(trail.length)
    assert (begin.x, begin.y) == pytest.approx((end.x, end.y), abs=1e-6)


@pytest.mark.parametrize("seed", TRAILS)
def test_a_lap_leads_from_meadow_through_forest_and_gravel_back_to_the_meadow(seed: int) -> None:
    trail = TRAILS[seed]
    zones = [trail.zone(s) for s in np.arange(trail.start, trail.start + trail.length, 0.5)]
    assert [zone for zone, _ in groupby(zones)] == ["meadow", "forest", "gravel", "meadow"]
    assert min(len(list(run)) for _, run in groupby(zones)) * 0.5 >= 10


@pytest.mark.parametrize("seed", TRAILS)
def test_the_route_keeps_away_from_itself(seed: int) -> None:
    points = TRAILS[seed].points[::10]
    gaps = np.hypot(*(points[:, None] - points[None, :]).transpose(2, 0, 1))
    steps = np.abs(np.subtract.outer(np.arange(len(points)), np.arange(len(points))))
    apart = np.minimum(steps, len(points) - steps) > 25
    assert gaps[apart].min() > 10


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 20), st.floats(-300, 300), st.floats(-6, 6))
def test_nearest_undoes_pose(seed: int, s: float, lateral: float) -> None:
    trail = TRAILS[seed]
    at = trail.pose(s)
    found, offset = trail.nearest(
        at.x - lateral * math.sin(at.heading), at.y + lateral * math.cos(at.heading)
    )
    assert offset == pytest.approx(lateral, abs=0.03)
    assert abs(math.remainder(found - s, trail.length)) < 0.15


def test_zones_blend_over_a_few_metres_and_shares_sum_to_one() -> None:
    trail = TRAILS[1]
    s = np.arange(0, trail.length, 0.25)
    shares = trail.shares(s)
    assert shares.sum(axis=1) == pytest.approx(np.ones(len(s)))
    blended = np.count_nonzero(shares.max(axis=1) < 0.999) * 0.25
    assert 3 * 5 <= blended <= 3 * 8


def test_the_same_seed_gives_the_same_route_and_another_seed_another() -> None:
    assert np.array_equal(Trail(7).points, TRAILS[7].points)
    assert len({round(trail.length, 1) for trail in TRAILS.values()}) > 10


def test_a_longer_trail_has_a_third_of_each_zone() -> None:
    trail = Trail(3, 600.0)
    assert trail.length == pytest.approx(600.0)
    for begin, end in trail.borders.values():
        assert end - begin == pytest.approx(200.0)


@pytest.mark.parametrize("half", [1.65, 2.25])
def test_a_path_is_as_wide_as_its_course_says_within_15_cm(half: float) -> None:
    s = np.arange(0.0, 200.0, 0.1)
    assert np.abs(Trail(1, course=Course(half=half)).half_width(s) - half).max() <= 0.15


def test_a_course_with_more_harmonics_bends_to_both_sides_as_tightly_as_it_may() -> None:
    trail = Trail(1, 124.0, Course(bends=(0.12, 0.09, 0.07, 0.05, 0.04), tightest=8.0))
    turns = np.diff(np.unwrap([trail.pose(s).heading for s in np.arange(0, trail.length, 0.5)])) / 0.5
    assert turns.min() < -1 / 30
    assert 1 / 12 < np.abs(turns).max() <= 1 / 7.5
