"""Whether the vehicle fits through, and what is drivable in which direction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.regions import Box
from anytraverse.roi import Corridor, corridor_open, sectors

Mask = NDArray[np.bool_]
WHOLE = Box(0, 0, 1, 1)
THIRD = Corridor(0.3, 0.3)


def ground(height: int = 30, width: int = 40) -> Mask:
    """Nothing in the way."""
    return np.zeros((height, width), dtype=np.bool_)


def test_free_ground_is_open() -> None:
    assert corridor_open(ground(), WHOLE, THIRD)


def test_a_wall_across_blocks() -> None:
    wall = ground()
    wall[14:16] = True
    assert not corridor_open(wall, WHOLE, THIRD)


def test_a_wall_outside_the_roi_does_not_count() -> None:
    wall = ground()
    wall[3] = True
    assert corridor_open(wall, Box(0, 0.2, 1, 1), THIRD)


@pytest.mark.parametrize(("gap", "passes"), [(12, True), (10, False)])
def test_a_gap_of_the_vehicles_width_passes_and_a_narrower_one_does_not(gap: int, passes: bool) -> None:
    wall = ground()
    wall[14:16] = True
    wall[14:16, 5 : 5 + gap] = False
    assert corridor_open(wall, WHOLE, THIRD) is passes


def test_gaps_too_far_apart_to_turn_between_do_not_make_a_corridor() -> None:
    walls = ground()
    walls[20, 12:] = True
    walls[14, :28] = True
    assert not corridor_open(walls, WHOLE, THIRD)
    walls = ground(50)
    walls[45, 12:] = True
    walls[5, :28] = True
    assert corridor_open(walls, WHOLE, THIRD)


def test_stray_pixels_do_not_block() -> None:
    specks = ground()
    specks[::3, 5::14] = True
    assert corridor_open(specks, WHOLE, THIRD)


def test_the_corridor_narrows_with_distance() -> None:
    funnel = ground()
    for row in range(30):
        free = 6 + round(6 * row / 29)
        funnel[row] = True
        funnel[row, 20 - free // 2 : 20 - free // 2 + free] = False
    assert corridor_open(funnel, WHOLE, Corridor(bottom=0.3, top=0.15))
    assert not corridor_open(funnel, WHOLE, THIRD)


def test_a_vehicle_wider_than_the_roi_needs_all_of_it() -> None:
    narrow, wide = Box(0.4, 0, 0.6, 1), Corridor(0.9, 0.9)
    assert corridor_open(ground(), narrow, wide)
    post = ground()
    post[10:20, 19:21] = True
    assert not corridor_open(post, narrow, wide)


def test_a_region_without_a_pixel_is_not_open() -> None:
    assert not corridor_open(ground(), Box(0.51, 0.51, 0.515, 0.515), THIRD)


def test_one_row_is_judged_by_the_width_at_the_bottom() -> None:
    row = ground(1)
    row[0, 8:] = True
    assert not corridor_open(row, WHOLE, Corridor(0.3, 0.1))
    assert corridor_open(row, WHOLE, Corridor(0.2, 0.9))


def slow_open(blocked: Mask, corridor: Corridor) -> bool:
    """Every path of strip positions, row by row."""
    count, across = blocked.shape
    reachable: set[int] | None = None
    for row in reversed(range(count)):
        rise = (count - 1 - row) / max(1, count - 1)
        wanted = (corridor.bottom + (corridor.top - corridor.bottom) * rise) * across
        strip = min(max(1, round(wanted)), across)
        free = {
            left + strip // 2
            for left in range(across - strip + 1)
            if blocked[row, left : left + strip].sum() <= 0.1 * strip
        }
        if reachable is not None:
            free = {at for at in free if reachable & {at - 1, at, at + 1}}
        reachable = free
    return bool(reachable)


@given(
    st.integers(1, 9),
    st.integers(1, 16),
    st.integers(0, 2**16),
    st.sampled_from([0.05, 0.15, 0.3]),
    st.sampled_from([Corridor(0.3, 0.2), Corridor(0.1, 0.1), Corridor(0.7, 0.3), Corridor(0.2, 1.5)]),
)
@settings(max_examples=150)
def test_it_is_open_when_some_path_of_strips_is_free(
    height: int, width: int, seed: int, density: float, corridor: Corridor
) -> None:
    blocked = np.random.default_rng(seed).random((height, width)) < density
    assert corridor_open(blocked, WHOLE, corridor) is slow_open(blocked, corridor)


@pytest.mark.parametrize("width", [0.0, -0.1, math.nan, math.inf])
def test_a_corridor_without_a_width_is_refused(width: float) -> None:
    with pytest.raises(SettingsError, match="above 0"):
        Corridor(width, 0.2)


def test_sectors_tell_the_drivable_share_of_what_is_known() -> None:
    known, drivable = ground(10, 16), ground(10, 16)
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
