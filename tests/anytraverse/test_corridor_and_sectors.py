"""Whether the vehicle fits through, and what is drivable in which direction."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.judging import Settings
from anytraverse.regions import Box
from anytraverse.roi import Corridor, corridor_open, sectors, tile_size

Mask = NDArray[np.bool_]
WHOLE = Box(0, 0, 1, 1)
THIRD = Corridor(0.3, 0.3)


TILE = (6, 6)
"""Rows and columns of a tile."""


def ground(height: int = 30, width: int = 40) -> Mask:
    """All of it drivable."""
    return np.ones((height, width), dtype=np.bool_)


def opened(drivable: Mask, region: Box = WHOLE, corridor: Corridor = THIRD) -> bool:
    return corridor_open(drivable, region, corridor, TILE)


def test_drivable_ground_is_open() -> None:
    assert opened(ground())


def test_without_any_evidence_it_is_closed() -> None:
    assert not opened(~ground())


def test_a_wall_across_closes_it() -> None:
    wall = ground()
    wall[14:16] = False
    assert not opened(wall)


def test_a_wall_outside_the_roi_does_not_count() -> None:
    wall = ground()
    wall[3] = False
    assert opened(wall, Box(0, 0.2, 1, 1))


@pytest.mark.parametrize(("gap", "passes"), [(12, True), (8, False)])
def test_a_way_of_the_vehicles_width_passes_and_a_narrower_one_does_not(gap: int, passes: bool) -> None:
    wall = ground()
    wall[12:18] = False
    wall[12:18, 5 : 5 + gap] = True
    assert opened(wall) is passes


def test_ways_too_far_apart_to_turn_between_do_not_make_a_corridor() -> None:
    walls = ground()
    walls[18:24, 12:] = False
    walls[12:18, :28] = False
    assert not opened(walls)
    walls = ground(50)
    walls[40:50, 12:] = False
    walls[:10, :28] = False
    assert opened(walls)


@pytest.mark.parametrize("far", [0, 29])
def test_a_few_stray_cells_at_either_edge_of_the_roi_do_not_close_it(far: int) -> None:
    specks = ground()
    specks[far, ::2] = False
    assert opened(specks)


def test_every_band_must_have_its_share_from_near_to_far() -> None:
    for band in range(5):
        thin = ground()
        thin[6 * band : 6 * band + 6, ::4] = False
        assert not opened(thin)
    assert opened(thin, corridor=Corridor(0.3, 0.3, share=0.7))
    assert opened(thin, corridor=Corridor(0.3, 0.3, bands=1))


def test_a_gap_as_large_as_a_tile_closes_a_corridor_that_has_its_share() -> None:
    wide = Corridor(0.95, 0.95)
    holed = ground()
    holed[9:15, 17:23] = False
    assert not opened(holed, corridor=wide)
    holed[9:15, 20] = True
    assert opened(holed, corridor=wide)


def test_the_corridor_narrows_with_distance() -> None:
    funnel = ~ground()
    for row in range(30):
        free = 6 + round(6 * row / 29)
        funnel[row, 20 - free // 2 : 20 - free // 2 + free] = True
    assert opened(funnel, corridor=Corridor(bottom=0.3, top=0.15, bottom_row=1.0, top_row=0.0))
    assert not opened(funnel)


def test_a_strip_that_does_not_fit_into_the_roi_is_closed() -> None:
    assert not opened(ground(), Box(0.4, 0, 0.6, 1), Corridor(0.9, 0.9))
    assert not opened(ground(), Box(0.1, 0, 0.9, 1), Corridor(0.9, 0.3, bottom_row=1.0, top_row=0.0))
    assert opened(ground(), Box(0.05, 0, 0.95, 1), Corridor(0.9, 0.9))


def test_a_strip_as_wide_as_the_roi_is_open_at_every_width_of_a_map() -> None:
    # In 79 columns the strip is 24 wide when it is rounded, and the ROI holds 23 of their centres.
    for width in range(20, 200):
        assert opened(ground(30, width), Box(0.35, 0, 0.65, 1), THIRD)


def test_a_roi_narrower_than_the_trail_between_rocks_does_not_make_the_vehicle_narrower() -> None:
    trail = ~ground(120, 160)
    trail[:, 72:88] = True
    for left, right in ((1 / 3, 2 / 3), (0.46, 0.54)):
        assert not opened(trail, Box(left, 0.6, right, 0.95), Corridor(0.3, 0.2))


def test_the_roi_moved_up_or_down_changes_the_vehicles_width_at_no_row() -> None:
    corridor, rows = Corridor(0.3, 0.2), 120
    way = ~ground(rows, 160)
    for row in range(rows):
        free = 50 - round((114 - row) * 16 / 42)  # a pixel or two more than the vehicle
        way[row, 80 - free // 2 : 80 - free // 2 + free] = True
    tight = way & np.roll(way, 2, axis=1) & np.roll(way, -2, axis=1)
    for top, bottom in ((0.6, 0.95), (0.3, 0.95), (0.8, 0.95), (0.6, 0.99), (0.7, 0.8)):
        region = Box(0.3, top, 0.7, bottom)
        assert opened(way, region, corridor)
        assert not opened(tight, region, replace(corridor, share=1.0))


@pytest.mark.slow
@given(
    st.integers(4, 120),
    st.floats(0.1, 0.9),
    st.floats(0.03, 0.8),
    st.floats(0.4, 1.0),
    st.data(),
)
@settings(max_examples=200)
def test_a_way_narrower_than_the_vehicle_is_closed_at_every_row_of_every_map(
    height: int, top_row: float, apart: float, tapers: float, data: st.DataObject
) -> None:
    bottom_row, width = min(1.0, top_row + apart), 1000
    corridor = Corridor(0.4, 0.4 * tapers, 1.0, bottom_row=bottom_row, top_row=top_row)
    region, way = (
        Box(0.0, data.draw(st.floats(0.0, bottom_row - 0.05)), 1.0, bottom_row),
        ground(height, width),
    )
    rows, _ = region.slices(height, width)
    assume(rows.start < rows.stop and not corridor.misfit(region))
    row = data.draw(st.integers(rows.start, rows.stop - 1))
    rise = (bottom_row - (row + 0.5) / height) / (bottom_row - top_row)
    way[row, max(0, math.floor((0.4 + (corridor.top - 0.4) * rise) * width) - 2) :] = False
    assert not corridor_open(way, region, corridor, (1, 1))


@given(
    st.integers(0, 2**16),
    st.floats(0.05, 1.0),
    st.floats(0.05, 1.0),
    st.lists(st.integers(0, 20), min_size=4, max_size=4, unique=True),
    st.tuples(st.integers(0, 8), st.integers(1, 9)),
    st.sampled_from([0.0, 0.02, 0.1, 0.3]),
)
@settings(max_examples=300)
def test_narrowing_the_roi_never_turns_closed_into_open(
    seed: int, bottom: float, top: float, sides: list[int], rows: tuple[int, int], density: float
) -> None:
    drivable = np.random.default_rng(seed).random((10, 20)) >= density
    left, inner_left, inner_right, right = (side / 20 for side in sorted(sides))
    low, high = rows[0] / 10, min(10, sum(rows)) / 10
    corridor = Corridor(bottom, top, share=0.7)
    wide, narrow = Box(left, low, right, high), Box(inner_left, low, inner_right, high)
    gap = (2, 2) if high - low > 0.15 else (1, 1)
    assert corridor_open(drivable, narrow, corridor, gap) <= corridor_open(drivable, wide, corridor, gap)


class Wedge:
    """A region that is no box: the whole width at the bottom, and a fifth of it at the top."""

    bounds = WHOLE
    corners = WHOLE.corners

    def mask(self, height: int, width: int) -> Mask:
        rows, columns = np.ogrid[:height, :width]
        aside: Mask = np.abs((columns + 0.5) / width - 0.5) <= 0.1 + 0.4 * rows / (height - 1)
        return aside


def test_the_strip_stays_inside_a_region_that_is_no_box() -> None:
    assert corridor_open(ground(), Wedge(), Corridor(0.3, 0.2, bottom_row=1.0, top_row=0.0), TILE)
    assert not corridor_open(ground(), Wedge(), Corridor(0.3, 0.25, bottom_row=1.0, top_row=0.0), TILE)


@pytest.mark.parametrize("region", [Settings().region.bounds, Box(0.333, 0.6, 0.667, 0.95)])
def test_in_a_part_of_a_map_every_path_of_strips_of_the_vehicles_width_counts(region: Box) -> None:
    rng, found = np.random.default_rng(0), set()
    for _ in range(100):
        height, width = int(rng.integers(4, 60)), int(rng.integers(6, 80))
        coarse = rng.random((height // 3 + 1, width // 3 + 1)) >= rng.choice([0.0, 0.1, 0.3])
        drivable = coarse.repeat(3, axis=0).repeat(3, axis=1)[:height, :width]
        gap = tile_size(height, width, region, width / height, 0.25)
        for factor in (1.0, 1.1):
            now = corridor_open(drivable, region, Corridor(0.3, 0.2).roomier(factor, 0.03), gap)
            alone = Corridor(0.3 * factor, 0.2 * factor, 0.83)
            assert now is slow_open(drivable[region.slices(height, width)], alone, gap, (height, width))
            found.add((factor, now))
    assert len(found) == 4


def test_a_region_without_a_pixel_is_not_open() -> None:
    assert not opened(ground(), Box(0.51, 0.51, 0.515, 0.515))


def test_one_row_is_judged_by_the_width_at_the_bottom() -> None:
    row = ground(1)
    row[0, 8:] = False
    assert not corridor_open(row, WHOLE, Corridor(0.3, 0.1), (1, 1))
    assert corridor_open(row, WHOLE, Corridor(0.2, 0.9, bottom_row=1.0, top_row=0.0), (1, 1))


def slow_open(
    drivable: Mask, corridor: Corridor, tile: tuple[int, int], whole: tuple[int, int] | None = None
) -> bool:
    """Every path of strip positions, band by band. The last row is that at the corridor's `bottom_row`.

    whole: rows and columns of the whole map, of which this may be a part.
    """
    count, across = drivable.shape
    height, width = whole or drivable.shape
    if not whole and max(corridor.bottom, corridor.top) > 1.0:
        return False
    gaps = {
        (top, left)
        for top in range(count - tile[0] + 1)
        for left in range(across - tile[1] + 1)
        if (~drivable[top : top + tile[0], left : left + tile[1]]).sum() >= 0.9 * tile[0] * tile[1]
    }
    at: set[int] | None = None
    for band in np.array_split(np.arange(count)[::-1], min(corridor.bands, count)):
        fewest: dict[int, int] = {} if at is None else dict.fromkeys(at, 0)
        cells = 0
        for row in band:
            rise = (count - 1 - row) / (height * (corridor.bottom_row - corridor.top_row))
            wanted = (corridor.bottom + (corridor.top - corridor.bottom) * rise) * width
            strip = min(max(1, round(wanted)), across)
            cells += strip
            here = {}
            for left in range(across - strip + 1):
                inside = [
                    gap
                    for gap in gaps
                    if gap[0] <= row < gap[0] + tile[0] and left <= gap[1] <= left + strip - tile[1]
                ]
                centre = left + strip // 2
                before = [fewest[near] for near in (centre - 1, centre, centre + 1) if near in fewest]
                if inside or not (before or (at is None and row == band[0])):
                    continue
                missing = int((~drivable[row, left : left + strip]).sum())
                here[centre] = min(before, default=0) + missing
            fewest = here
        at = {centre for centre, missing in fewest.items() if missing <= (1 - corridor.share) * cells + 1e-9}
    return bool(at)


@given(
    st.integers(1, 9),
    st.integers(1, 16),
    st.integers(0, 2**16),
    st.sampled_from([0.05, 0.15, 0.3]),
    st.sampled_from(
        [(0.3, 0.2, 0.8, 5), (0.1, 0.1, 0.8, 5), (0.7, 0.3, 0.9, 3), (0.2, 1.0, 0.8, 5), (0.2, 1.5, 0.8, 5)]
    ),
    st.sampled_from([(1, 1), (2, 2), (3, 2)]),
)
@settings(max_examples=150)
def test_it_is_open_when_some_path_of_strips_has_its_share_in_every_band(
    height: int,
    width: int,
    seed: int,
    density: float,
    of: tuple[float, float, float, int],
    tile: tuple[int, int],
) -> None:
    corridor = Corridor(*of, bottom_row=1.0, top_row=0.0)
    drivable = np.random.default_rng(seed).random((height, width)) >= density
    tile = min(tile[0], height), min(tile[1], width)
    assert corridor_open(drivable, WHOLE, corridor, tile) is slow_open(drivable, corridor, tile)


@pytest.mark.parametrize("width", [0.0, -0.1, math.nan, math.inf])
def test_a_corridor_without_a_width_is_refused(width: float) -> None:
    with pytest.raises(SettingsError, match="above 0"):
        Corridor(width, 0.2)


@pytest.mark.parametrize(
    "rows", [(0.6, 0.6), (0.5, 0.6), (1.1, 0.6), (0.9, -0.1), (math.nan, 0.6), (0.9, math.nan)]
)
def test_a_corridor_whose_widths_hold_at_no_two_rows_is_refused(rows: tuple[float, float]) -> None:
    with pytest.raises(SettingsError, match="top_row above bottom_row"):
        Corridor(0.3, 0.2, bottom_row=rows[0], top_row=rows[1])


@pytest.mark.parametrize("wrong", [{"share": 0.0}, {"share": 1.1}, {"share": math.nan}, {"bands": 0}])
def test_a_corridor_that_asks_for_nothing_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match="asks for nothing"):
        Corridor(0.3, 0.2, **wrong)


def test_sectors_tell_the_drivable_share_of_what_is_known() -> None:
    known, drivable = ~ground(10, 16), ~ground(10, 16)
    known[5:, :8] = True
    drivable[5:, :4] = True
    drivable[5, 4:8] = True
    roi = Box(0.4, 0.5, 0.6, 1)
    assert sectors(known, drivable, roi, 4) == (1.0, 0.2, None, None)
    assert len(sectors(known, drivable, roi)) == 16


def test_a_map_narrower_than_the_sectors_leaves_some_unknown() -> None:
    known = np.ones((4, 3), dtype=np.bool_)
    shares = sectors(known, known, WHOLE, 16)
    assert len(shares) == 16
    assert [share for share in shares if share is not None] == [1.0] * 3
