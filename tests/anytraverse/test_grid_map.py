"""What a grid knew at a moment, in bytes, and the picture of it from above."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.frame import Pose
from anytraverse.grid import CELL, SIDE, LocalGrid
from anytraverse.grid_map import AHEAD, ASIDE, BEHIND, UNKNOWN, GridMap, draw_from_above
from companion.storage.served_files import png
from tests.anytraverse.test_grid import CAMERA, HORIZON, REGION, maps, standing

NOT_SEEN, DRIVABLE, BLOCKED, UNEXPLAINED = (222, 226, 230), (102, 197, 171), (213, 94, 0), (126, 47, 190)
ANYWHERE = st.builds(Pose, st.floats(-900, 900), st.floats(-900, 900), st.floats(0, 360))


def seen(pose: Pose, thing: np.ndarray, named: bool = False) -> GridMap:
    """What is known after one frame from there. named: a word explains the thing."""
    grid, shown = LocalGrid(), maps(thing)
    if named:
        shown.uncertainty[:] = 0.05
    grid.update(shown, CAMERA, pose, 3.0)
    found = GridMap.of(grid, 3.0)
    assert found is not None
    return found


def colours(picture: np.ndarray, ahead: float, left: float) -> tuple[int, ...]:
    """The colour of a place in m ahead of the lens and to its left."""
    row, column = round((AHEAD - ahead) / CELL * 3), round((ASIDE - left) / CELL * 3)
    return tuple(int(one) for one in picture[row, column])


def test_without_a_place_of_the_vehicle_there_is_no_map() -> None:
    assert GridMap.of(LocalGrid(), 1.0) is None


@given(pose=ANYWHERE)
@settings(deadline=None, max_examples=40)
def test_ground_and_a_thing_are_where_they_were_seen_however_the_vehicle_is_turned(pose: Pose) -> None:
    picture = draw_from_above(seen(pose, standing(3.0, 0.5, 0.6)))
    assert picture.shape == (round(300 * (AHEAD + BEHIND) / 10), round(240 * 2 * ASIDE / 8), 3)
    assert colours(picture, 2.5, 0.0) == DRIVABLE
    thing = picture[round((AHEAD - 3.3) * 30) : round((AHEAD - 2.9) * 30), round((ASIDE - 0.6) * 30)]
    assert UNEXPLAINED in {tuple(map(int, one)) for one in thing}
    assert colours(picture, -2.0, 0.0) == NOT_SEEN


def test_what_a_word_explains_has_another_colour() -> None:
    picture = draw_from_above(seen(Pose(0.0, 0.0, 0.0), standing(3.0, 0.5, 0.6), named=True))
    found = {tuple(map(int, one)) for one in picture.reshape(-1, 3)}
    assert BLOCKED in found
    assert UNEXPLAINED not in found


def test_the_vehicle_its_way_its_region_and_where_it_stands_are_drawn() -> None:
    told = seen(Pose(0.0, 0.0, 0.0), np.zeros((48, 64), bool))
    picture = draw_from_above(told, REGION, stops=2.0)
    assert colours(picture, 0.3 + 2.0, 0.0) == (200, 30, 30)
    assert colours(picture, 0.3 + REGION.far, 0.1) == (255, 255, 255)
    assert colours(picture, 1.0, 0.3) == (255, 225, 60)
    beyond = draw_from_above(told, REGION, stops=8.0)
    assert (200, 30, 30) not in {tuple(map(int, one)) for one in beyond.reshape(-1, 3)}


@given(
    corner=st.tuples(st.integers(-(10**6), 10**6), st.integers(-(10**6), 10**6)),
    pose=ANYWHERE,
    fill=st.integers(0, 255),
)
@settings(deadline=None, max_examples=40)
def test_any_map_can_be_drawn(corner: tuple[int, int], pose: Pose, fill: int) -> None:
    cells = bytes([fill]) * (SIDE * SIDE)
    assert draw_from_above(GridMap(0.0, pose, corner, cells, cells), REGION, 1.0).dtype == np.uint8


def test_it_becomes_a_png_without_opencv_that_opencv_reads() -> None:
    picture = draw_from_above(seen(Pose(5.0, 1.0, 30.0), standing(3.0, 0.5, 0.6)))
    content = png(picture)
    assert len(content) < 8_000
    read = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    assert np.array_equal(read[..., ::-1], picture)


@pytest.mark.parametrize("layer", [0, 1])
def test_what_was_not_seen_is_unknown_in_both_layers(layer: int) -> None:
    told = seen(Pose(0.0, 0.0, 0.0), np.arange(48)[:, np.newaxis].repeat(64, 1) < HORIZON)
    cells = told.layers[layer]
    assert 0.02 < float((cells != UNKNOWN).mean()) < 0.3


def test_a_planned_way_is_drawn_where_it_leads_and_not_beyond_the_picture() -> None:
    told = seen(Pose(5.0, 1.0, 90.0), np.zeros((48, 64), bool))
    planned = [Pose(5.0, 1.0 + 0.05 * n, 90.0) for n in range(40)] + [Pose(3.0, 3.0, 90.0)]
    far = [Pose(5.0 + away, 1.0 + away, 0.0) for away in (-500.0, -4.1, 4.1, 6.1, 500.0)]
    picture = draw_from_above(told, planned=[*planned, *far])
    assert colours(picture, 1.0, 0.0) == (0, 72, 186)
    assert colours(picture, 2.0, 2.0) == (0, 72, 186)
    assert colours(picture, 2.2, 0.0) != (0, 72, 186)
    assert not (draw_from_above(told, planned=far) == (0, 72, 186)).all(axis=2).any()
