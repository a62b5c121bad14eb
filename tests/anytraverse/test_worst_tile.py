"""The square window of the ROI that is most uncertain."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.regions import Box
from anytraverse.roi import tile_size, worst_tile

Uncertainty = NDArray[np.float32]
ROI = Box(0.25, 0.5, 0.75, 1.0)


@st.composite
def maps(draw: st.DrawFn) -> Uncertainty:
    """Small uncertainty maps."""
    height, width = draw(st.integers(4, 14)), draw(st.integers(4, 14))
    seed = draw(st.integers(0, 2**16))
    return np.random.default_rng(seed).random((height, width), dtype=np.float32)


def slow_worst(
    uncertainty: Uncertainty, region: Box, size: tuple[int, int], outside: Box | None
) -> tuple[float, int]:
    """The highest mean over all windows of (height, width), and how many windows there are."""
    height, width = uncertainty.shape
    counted = region.mask(height, width)
    if outside is not None:
        counted &= ~outside.mask(height, width)
    rows, columns = region.slices(height, width)
    worst, windows = -1.0, 0
    for top in range(rows.start, rows.stop - size[0] + 1):
        for left in range(columns.start, columns.stop - size[1] + 1):
            window = np.s_[top : top + size[0], left : left + size[1]]
            values = uncertainty[window][counted[window]].astype(np.float64)
            if values.size and values.size >= 0.5 * size[0] * size[1]:
                worst, windows = max(worst, float(values.mean())), windows + 1
    return worst, windows


@given(maps(), st.sampled_from([0.2, 0.4, 0.7, 1.0]), st.sampled_from([None, "left", "middle", "all"]))
@settings(max_examples=120)
def test_it_is_the_highest_mean_of_all_windows(
    uncertainty: Uncertainty, share: float, where: str | None
) -> None:
    outside = {"left": Box(0, 0, 0.5, 1), "middle": Box(0.4, 0.6, 0.6, 0.9), "all": Box(0, 0, 1, 1)}
    cut = outside[where] if where else None
    height, width = uncertainty.shape
    rows, columns = ROI.slices(height, width)
    tile_height = min(max(1, round(share * 0.5 * height)), rows.stop - rows.start)
    tile_width = min(max(1, round(share * 0.5 * width)), columns.stop - columns.start)
    expected, windows = slow_worst(uncertainty, ROI, (tile_height, tile_width), cut)
    tile = worst_tile(uncertainty, ROI, 1.0, share, cut.mask(height, width) if cut else None)
    if not windows:
        assert tile is None
        return
    assert tile is not None
    assert tile.uncertainty == pytest.approx(expected, abs=1e-9)
    window_rows, window_columns = tile.box.slices(height, width)
    assert uncertainty[window_rows, window_columns].shape == (tile_height, tile_width)
    own, _ = slow_worst(uncertainty, tile.box, (tile_height, tile_width), cut)
    assert own == pytest.approx(expected, abs=1e-9)


def test_a_drum_hardly_moves_the_mean_but_fills_the_worst_tile() -> None:
    uncertainty = np.zeros((80, 80), dtype=np.float32)
    uncertainty[60:70, 42:52] = 1
    tile = worst_tile(uncertainty, ROI, 1.0)
    assert tile is not None
    assert tile.uncertainty == 1
    assert tile.box == Box(42 / 80, 60 / 80, 52 / 80, 70 / 80)
    assert uncertainty[ROI.mask(80, 80)].mean() < 0.07


def test_a_tile_is_square_in_the_picture_whatever_the_maps_shape() -> None:
    tile = worst_tile(np.ones((60, 60), dtype=np.float32), Box(0, 0, 1, 1), 2.0)
    assert tile is not None
    picture_width, picture_height = 2.0 * (tile.box.right - tile.box.left), tile.box.bottom - tile.box.top
    assert picture_width == pytest.approx(picture_height, rel=0.05)


@pytest.mark.parametrize(
    ("height", "width", "share", "size"),
    [
        (40, 64, 0.25, (5, 5)),
        (40, 64, 0.12, (3, 3)),
        (40, 64, 0.08, (2, 2)),
        (48, 64, 0.08, (2, 2)),
        (32, 64, 0.08, (2, 2)),
        (34, 64, 0.08, (2, 2)),
        (40, 64, 0.01, (1, 1)),
        (352, 352, 0.08, (13, 9)),
    ],
)
def test_small_tiles_are_as_many_cells_as_fit_best(
    height: int, width: int, share: float, size: tuple[int, int]
) -> None:
    aspect = width / height if height != width else 4 / 3
    assert tile_size(height, width, Box(1 / 3, 0.6, 2 / 3, 0.95), aspect, share) == size


@given(st.integers(0, 2**16), st.integers(1, 4), st.integers(1, 4))
@settings(max_examples=80)
def test_a_tile_several_times_as_large_is_never_worse_than_the_worst_small_one(
    seed: int, small: int, times: int
) -> None:
    uncertainty = np.random.default_rng(seed).random((32, 32), dtype=np.float32)
    whole = Box(0, 0, 1, 1)
    one, other = (worst_tile(uncertainty, whole, 1.0, side / 32) for side in (small, small * times))
    assert one is not None
    assert other is not None
    assert other.uncertainty <= one.uncertainty + 1e-9


def test_what_stands_in_the_accepted_box_does_not_count_outside_it() -> None:
    uncertainty = np.zeros((80, 80), dtype=np.float32)
    uncertainty[60:70, 42:52] = 1
    tile = worst_tile(uncertainty, ROI, 1.0, outside=Box(0.5, 0.7, 0.68, 0.9).mask(80, 80))
    assert tile is not None
    assert tile.uncertainty == 0


def test_a_second_thing_beside_the_accepted_box_counts() -> None:
    uncertainty = np.zeros((80, 80), dtype=np.float32)
    uncertainty[60:70, 42:52] = 1
    uncertainty[60:70, 22:32] = 0.9
    tile = worst_tile(uncertainty, ROI, 1.0, outside=Box(0.5, 0.7, 0.68, 0.9).mask(80, 80))
    assert tile is not None
    assert tile.uncertainty == pytest.approx(0.9)


def test_a_region_without_a_pixel_has_no_tile() -> None:
    assert worst_tile(np.ones((10, 10), dtype=np.float32), Box(0.51, 0.51, 0.52, 0.52), 1.0) is None


def test_not_a_number_is_not_passed_over() -> None:
    uncertainty = np.zeros((20, 20), dtype=np.float32)
    uncertainty[15, 10] = math.nan
    tile = worst_tile(uncertainty, ROI, 1.0)
    assert tile is not None
    assert math.isnan(tile.uncertainty)


def test_of_a_thing_whose_foot_reaches_into_the_far_side_the_whole_square_is_shown() -> None:
    camera = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3)
    seen = GroundRegion(camera, 0.5, 5.0, 1.2, 0.6).in_picture(None)
    first = seen.region.bounds.slices(48, 64)[0].start
    uncertainty = np.zeros((48, 64), np.float32)
    uncertainty[first - 8 : first + 1, 29:35] = 1.0
    tile = worst_tile(uncertainty, seen.region, 4 / 3, seen.tiles)
    assert tile is not None
    assert tile.uncertainty == pytest.approx(1.0)
    assert tile.box.slices(48, 64)[0] == slice(first, first + 1)
    rows, columns = tile.shown.slices(48, 64)
    assert rows.stop == first + 1
    assert rows.stop - rows.start == pytest.approx(columns.stop - columns.start, abs=1)
    assert seen.region.bounds.contains(*tile.box.centre)
