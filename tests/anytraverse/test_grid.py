"""The grid that remembers for seconds which ground around the vehicle is drivable."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Maps
from anytraverse.frame import Pose
from anytraverse.grid import _DEEPEST, CELL, REMEMBERED, SIDE, LocalGrid
from anytraverse.ground import RELIABLE, GroundCamera, GroundRegion

CAMERA = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3, front=0.3)
REGION = GroundRegion(CAMERA, near=1.1, far=4.5, width=1.4, vehicle=0.6)
ROWS, COLUMNS = 48, 64
START = Pose(0.0, 0.0, 0.0)
HORIZON = 20
"""A row below the horizon of a camera that leans by at most 2 degrees."""


def maps(thing: np.ndarray) -> Maps:
    """Drivable ground, but for what a thing shows."""
    uncertainty = np.where(thing, 0.9, 0.05).astype(np.float32)
    known = np.ones_like(thing)
    return Maps(
        (1.0 - uncertainty)[np.newaxis],
        1.0 - uncertainty,
        uncertainty,
        uncertainty,
        ~thing,
        np.zeros(1, bool),
        known,
    )


def standing(ahead: float, left: float, side: float, lean: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Sky, and the pixels of an upright square thing whose foot is there."""
    camera = CAMERA.leaning(*lean)
    feet = camera.to_picture(np.array([[ahead, left + side / 2], [ahead, left - side / 2]]))
    x, y = (np.arange(COLUMNS) + 0.5) / COLUMNS, ((np.arange(ROWS) + 0.5) / ROWS)[:, np.newaxis]
    width, foot = feet[1, 0] - feet[0, 0], feet[:, 1].mean()
    thing = (x > feet[0, 0]) & (x < feet[1, 0]) & (y < foot) & (y > foot - width * 4 / 3)
    sky = np.isnan(camera.to_ground(np.column_stack([np.full(ROWS, 0.5), y[:, 0]])))[:, :1]
    return np.asarray(thing | sky)


FREE = maps(standing(100.0, 50.0, 0.1))


def seen(thing: np.ndarray, pose: Pose = START, lean: tuple[float, float] = (0.0, 0.0)) -> LocalGrid:
    grid = LocalGrid()
    grid.update(maps(thing), CAMERA.leaning(*lean), pose, 1.0)
    return grid


def where(grid: LocalGrid, cells: np.ndarray) -> np.ndarray:
    """Where cells are: m ahead of the lens and to its left, (n, 2)."""
    return grid.to_vehicle(grid.places(*np.nonzero(cells)))


def contents(grid: LocalGrid) -> dict[tuple[int, int], tuple[float, float, float]]:
    """What is known, by the cell's number from odometry's start."""
    return {
        (int(column) + grid.corner[0], int(row) + grid.corner[1]): (
            float(grid.share[row, column]),
            float(grid.uncertainty[row, column]),
            float(grid.age[row, column]),
        )
        for row, column in zip(*np.nonzero(grid.known), strict=True)
    }


POSES = st.builds(Pose, st.floats(-50, 50), st.floats(-50, 50), st.floats(-720, 720))
WAYS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=6)


def test_a_thing_is_marked_where_its_foot_is_and_nothing_behind_it() -> None:
    grid = seen(standing(3.0, 0.4, 0.6))
    found = where(grid, grid.blocked)
    middle = found[np.abs(found[:, 1]) < 1.0]
    assert np.allclose(middle.mean(axis=0), (3.0, 0.4), atol=0.15)
    assert np.ptp(middle[:, 0]) < 0.5
    behind = where(grid, grid.known)
    assert not ((behind[:, 0] > 3.5) & (np.abs(behind[:, 1] - 0.4) < 0.25)).any()
    assert (where(grid, grid.drivable)[:, 0] > 5.0).any()


def test_a_lean_moves_nothing() -> None:
    for lean in ((4.0, 0.0), (-4.0, 3.0), (0.0, -5.0)):
        grid = seen(standing(3.0, 0.4, 0.6, lean), lean=lean)
        found = where(grid, grid.blocked)
        assert np.allclose(found[np.abs(found[:, 1]) < 1.0].mean(axis=0), (3.0, 0.4), atol=0.25)


def test_what_leans_by_too_much_marks_nothing() -> None:
    assert not seen(standing(3.0, 0.0, 0.6), lean=(13.0, 0.0)).known.any()


@given(POSES)
@settings(max_examples=20, deadline=None)
def test_wherever_the_vehicle_is_and_looks_it_sees_the_same(pose: Pose) -> None:
    one, other = seen(standing(3.0, 0.4, 0.6)), seen(standing(3.0, 0.4, 0.6), pose)
    for cells in ("blocked", "drivable"):
        count = int(getattr(one, cells).sum())
        assert int(getattr(other, cells).sum()) == pytest.approx(count, rel=0.05, abs=12)
    found = where(other, other.blocked)
    assert np.allclose(found[np.abs(found[:, 1]) < 1.0].mean(axis=0), (3.0, 0.4), atol=0.15)


@given(POSES, WAYS)
@settings(max_examples=25, deadline=None)
def test_whole_cells_are_shifted_as_if_the_grid_had_been_made_there(
    pose: Pose, ways: list[tuple[float, float]]
) -> None:
    grid, kept = seen(standing(3.0, 0.4, 0.6), pose), dict[tuple[int, int], tuple[float, float, float]]()
    kept = contents(grid)
    for number, (x, y) in enumerate(ways, 1):
        pose = Pose(pose.x + x, pose.y + y, pose.heading)
        grid.move(pose, 1.0 + 1.5 * number)
        first = [math.floor(axis / CELL) - SIDE // 2 for axis in pose[:2]]
        kept = {
            cell: (share, uncertainty, age + 1.5)
            for cell, (share, uncertainty, age) in kept.items()
            if all(0 <= one - low < SIDE for one, low in zip(cell, first, strict=True))
            and age + 1.5 <= REMEMBERED
        }
        assert contents(grid) == kept


@given(st.lists(st.floats(0.0, 4.0), min_size=1, max_size=12))
@settings(max_examples=25, deadline=None)
def test_what_is_not_seen_again_fades(passed: list[float]) -> None:
    grid = seen(standing(3.0, 0.4, 0.6))
    now = 1.0
    for step in passed:
        now += step
        grid.move(START, now)
    if abs(now - 1.0 - REMEMBERED) > 0.01:
        assert grid.known.any() == (now - 1.0 <= REMEMBERED)
    assert not (grid.drivable & ~grid.known).any()


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.floats(0.002, 0.1), st.floats(-2, 2), st.floats(-4, 4))
@settings(max_examples=25, deadline=None)
def test_nothing_is_marked_behind_a_foot(seed: int, share: float, pitch: float, bank: float) -> None:
    thing = np.random.default_rng(seed).random((ROWS, COLUMNS)) < share
    thing[:HORIZON] = True
    camera = CAMERA.leaning(pitch, bank)
    grid = seen(thing, lean=(pitch, bank))
    cells = where(grid, grid.known)
    if not len(cells):
        return
    far = np.hypot(cells[:, 0], cells[:, 1])
    for way in np.arange(1.0, RELIABLE, 0.02):
        on_sight = way < far - _DEEPEST - 0.02
        places = camera.to_picture(cells[on_sight] * (way / far[on_sight])[:, np.newaxis])
        across, down = places[:, 0] * COLUMNS, places[:, 1] * ROWS
        inside = (across >= 0) & (across < COLUMNS) & (down >= 0) & (down < ROWS)
        inside &= np.abs(across % 1.0 - 0.5) < 0.3
        assert not thing[down[inside].astype(int), across[inside].astype(int)].any()


@given(st.lists(st.tuples(POSES, st.floats(-5, 5)), max_size=8))
@settings(max_examples=20, deadline=None)
def test_however_it_is_driven_it_stays_as_large_as_it_is(frames: list[tuple[Pose, float]]) -> None:
    grid, now = LocalGrid(), 0.0
    for pose, passed in frames:
        now += passed
        grid.update(FREE, CAMERA, pose, now)
        layers = (grid.share, grid.uncertainty, grid.age)
        assert sum(layer.nbytes for layer in layers) == 480_000
        assert all(layer.shape == (SIDE, SIDE) for layer in layers)
        assert set(vars(grid)) == set(vars(LocalGrid()))
        assert not np.isnan([layer.sum() for layer in layers[:2]]).any()


@given(POSES, st.integers(0, SIDE - 1), st.integers(0, SIDE - 1))
@settings(max_examples=30, deadline=None)
def test_a_cells_place_leads_back_to_it(pose: Pose, row: int, column: int) -> None:
    grid = LocalGrid()
    grid.move(pose, 0.0)
    place = grid.places(np.array(row), np.array(column))
    assert [int(one) for one in grid.cells(place)] == [row, column, True]
    assert np.allclose(grid.from_vehicle(grid.to_vehicle(place)), place)
    assert not grid.cells(np.array([pose.x + 11.0, pose.y]))[2]


def test_left_is_to_the_left_of_the_nose() -> None:
    grid = LocalGrid()
    grid.move(Pose(5.0, 7.0, 90.0), 0.0)
    assert np.allclose(grid.from_vehicle(np.array([2.0, 1.0])), (4.0, 9.0))


@pytest.mark.parametrize(
    ("pose", "now"),
    [
        (None, 1.1),
        (Pose(math.nan, 0.0, 0.0), 1.1),
        (Pose(0.0, math.inf, 0.0), 1.1),
        (Pose(0.0, 0.0, math.nan), 1.1),
        (Pose(2e6, 0.0, 0.0), 1.1),
        (START, math.nan),
        (START, 0.9),
        (Pose(0.9, 0.0, 0.0), 1.1),
        (Pose(0.0, 0.0, 30.0), 1.1),
    ],
    ids=["none", "nan", "infinite", "no heading", "far away", "no time", "back in time", "jump", "turn"],
)
def test_odometry_that_cannot_be_believed_makes_all_unknown(pose: Pose | None, now: float) -> None:
    grid = seen(standing(3.0, 0.4, 0.6))
    grid.move(pose, now)
    assert not grid.known.any()
    assert not grid.patch(REGION).known.any()
    grid.update(FREE, CAMERA, START, 2.0)
    grid.update(FREE, CAMERA, START, 2.1)
    assert grid.drivable.any()


def test_without_a_place_there_is_no_way_from_the_vehicle() -> None:
    with pytest.raises(ValueError, match="place is not known"):
        LocalGrid().from_vehicle(np.zeros(2))


def test_a_heading_that_passes_180_degrees_is_no_turn() -> None:
    grid = seen(standing(3.0, 0.4, 0.6), Pose(0.0, 0.0, 179.0))
    grid.move(Pose(0.1, 0.0, -179.0), 1.1)
    assert grid.known.any()


def test_a_thing_that_one_frame_shows_blocks_nothing_but_hides_what_is_behind_it() -> None:
    grid = LocalGrid()
    for number in range(5):
        grid.update(FREE, CAMERA, START, 0.1 * number)
    before = grid.blocked, grid.drivable
    grid.update(maps(standing(3.0, 0.0, 0.6)), CAMERA, START, 0.5)
    assert not (grid.blocked & ~before[0]).any()
    hidden = where(grid, before[1] & ~grid.drivable)
    assert (np.abs(hidden[:, 1]) < 0.6).all()
    assert ((hidden[:, 0] > 2.9) & (hidden[:, 0] < 4.1)).all()
    assert (where(grid, grid.drivable)[:, 0] > 5.0).any()
    grid.update(maps(standing(3.0, 0.0, 0.6)), CAMERA, START, 0.6)
    assert (grid.blocked & ~before[0]).any()
    grid.update(FREE, CAMERA, START, 0.7)
    assert (grid.drivable == before[1]).all()


def drive_to(grid: LocalGrid, thing_at: float, last: float) -> None:
    """Drive towards a thing of 0.6 m, frame by frame, until the lens is `last` m along the way."""
    for number in range(round(last / 0.1) + 1):
        way = 0.1 * number
        grid.update(maps(standing(thing_at - way, 0.0, 0.6)), CAMERA, Pose(way, 0.0, 0.0), 0.1 * number)


def test_a_thing_whose_foot_has_left_the_picture_is_held_until_it_is_passed() -> None:
    grid = LocalGrid()
    drive_to(grid, 4.0, 3.2)
    patch = grid.patch(REGION)
    rows, columns = np.nonzero(patch.known & ~patch.drivable)
    front = 4.5 - (rows + 0.5) * CELL
    assert ((front > 0.2) & (front < 0.8)).any()
    assert np.abs(0.7 - (columns[front < 1.0] + 0.5) * CELL).max() < 0.6


def test_ground_before_the_front_that_was_driven_up_to_is_known() -> None:
    grid = LocalGrid()
    for number in range(25):
        grid.update(FREE, CAMERA, Pose(0.1 * number, 0.0, 0.0), 0.1 * number)
    assert grid.patch(REGION).drivable.all()
    assert grid.patch(REGION, -1.0).drivable.all()
    assert grid.patch(REGION).drivable.shape == (45, 14)


def test_a_thing_whose_foot_was_never_seen_leaves_no_free_ground_before_it() -> None:
    grid = LocalGrid()
    for number in range(25):
        grid.update(FREE, CAMERA, Pose(0.1 * number, 0.0, 0.0), 0.1 * number)
    grid.update(maps(standing(0.9, 0.0, 0.6)), CAMERA, Pose(2.5, 0.0, 0.0), 2.5)
    assert not grid.patch(REGION).drivable[-8:, 6:8].any()
    assert grid.patch(REGION).drivable[-8:, 0].all()


def test_left_is_left_in_a_patch() -> None:
    grid = seen(standing(3.0, 0.5, 0.3))
    blocked = np.argwhere(grid.patch(REGION).known & ~grid.patch(REGION).drivable)
    assert blocked[:, 1].max() < 5
    assert abs(4.8 - (blocked[:, 0].mean() + 0.5) * CELL - 3.0) < 0.2


@pytest.mark.parametrize("side", [48, 96, 352])
def test_its_memory_is_bounded_however_fine_the_maps_and_however_steep_the_camera(side: int) -> None:
    steep = GroundCamera.pinhole(1.0, 45.0, 90.0, 4 / 3, front=0.3).leaning(-11.0, 0.0)
    grid = LocalGrid()
    tracemalloc.start()
    grid.update(maps(np.ones((side, side), bool)), steep, START, 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60 << 20
    assert not grid.drivable.any()


def test_what_is_small_in_fine_maps_still_marks_its_foot() -> None:
    thing = np.zeros((352, 352), bool)
    thing[230:236, 170:173] = True
    grid = LocalGrid()
    grid.update(maps(thing), CAMERA, START, 1.0)
    assert grid.blocked.any()
