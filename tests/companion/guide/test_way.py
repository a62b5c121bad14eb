"""How the mission leads on from where the vehicle is, and how far ground along that is free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.frame import Pose
from anytraverse.grid import CELL, FARTHEST, LocalGrid
from anytraverse.ground import RELIABLE
from companion.guide.plan import Route
from companion.guide.way import AHEAD, ahead_of, clear_along, direction

PLACES = st.tuples(st.floats(-FARTHEST, FARTHEST), st.floats(-FARTHEST, FARTHEST))

START = Pose(0.0, 0.0, 0.0)


def course_of(*points: tuple[float, float], pose: Pose = START) -> np.ndarray:
    found = ahead_of(points, pose)
    assert found is not None
    return found


def test_the_way_begins_beside_the_vehicle_and_leads_on_past_the_last_point() -> None:
    found = course_of((-40.0, 1.0), (2.0, 1.0), pose=Pose(-1.0, 0.0, 0.0))
    assert found[0] == pytest.approx((-1.0, 1.0))
    assert found[-1] == pytest.approx((-1.0 + AHEAD - CELL, 1.0))


def test_it_turns_where_the_mission_does() -> None:
    found = course_of((0.0, 0.0), (3.0, 0.0), (3.0, 20.0), pose=Pose(1.0, 0.5, 0.0))
    assert found[20] == pytest.approx((3.0, 0.0))
    assert found[40] == pytest.approx((3.0, 2.0))


@pytest.mark.parametrize("aside", [-1.0, 1.0, 1.4, 2.0, 2.9])
def test_of_a_mission_that_leads_there_and_back_the_lane_that_is_being_driven_counts(aside: float) -> None:
    there_and_back = ((0.0, 0.0), (50.0, 0.0), (50.0, 3.0), (0.0, 3.0))
    pose = Pose(10.0, aside, 0.0)
    assert course_of(*there_and_back, pose=pose)[50] == pytest.approx((15.0, 0.0))
    heading, left = Route(there_and_back, 2.0).at(pose)
    assert (heading, left) == pytest.approx((0.0, 93.0))


def test_at_the_tip_of_a_v_the_lane_back_is_not_reached_before_it() -> None:
    route = Route(((0.0, 0.0), (20.0, 0.0), (0.0, 3.0)), 2.0)
    heading, left = route.at(Pose(15.0, 0.5, 0.0))
    assert (heading, left) == pytest.approx((0.0, 5.0 + math.hypot(20.0, 3.0)))


@given(st.floats(-900.0, 900.0), st.floats(-900.0, 900.0), st.floats(-3.1, 3.1), st.floats(0.1, 3.0))
def test_beyond_its_end_a_way_leads_as_it_did_before(x: float, y: float, turn: float, beyond: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    route = Route(((x, y), (x + 7.0 * c, y + 7.0 * s), (x + 16.0 * c, y + 16.0 * s)), 2.0)
    heading, _ = route.at(Pose(x + (16.0 + beyond) * c, y + (16.0 + beyond) * s, 0.0))
    assert math.remainder(heading - math.degrees(turn), 360.0) == pytest.approx(0.0, abs=0.01)


def test_at_its_corner_a_way_leads_where_the_next_leg_does() -> None:
    route = Route(((0.0, 0.0), (4.0, 0.0), (4.0, 0.0), (4.0, 20.0)), 2.0)
    assert route.at(Pose(4.5, -0.5, 0.0)) == pytest.approx((90.0, 20.0))
    assert route.at(Pose(4.5, 3.0, 0.0)) == pytest.approx((90.0, 17.0))
    assert route.at(Pose(9.0, 29.0, 0.0)) == pytest.approx((90.0, 0.0))


def test_the_direction_is_told_from_the_nose() -> None:
    assert direction(course_of((0.0, 0.0), (9.0, 9.0)), Pose(0.0, 0.0, 405.0)) == pytest.approx(0.0)
    left = direction(course_of((0.0, 0.0), (9.0, 0.0)), Pose(0.0, 0.0, -30.0))
    assert left == pytest.approx(math.radians(30.0))


def test_the_first_ground_that_is_not_free_over_the_whole_width_ends_it() -> None:
    grid, pose = LocalGrid(), Pose(0.0, 0.0, 0.0)
    grid.move(pose, 1.0)
    free = np.ones_like(grid.known)
    course = course_of((0.0, 0.0), (9.0, 0.0))
    assert clear_along(grid, free, course, pose, 0.6) == (RELIABLE, False)
    ((row,), (column,), _) = grid.cells(np.array([[3.05, 0.55]]))
    free[row, column] = False
    clear, blocked = clear_along(grid, free, course, pose, 0.6)
    assert clear == pytest.approx(3.0, abs=CELL)
    assert not blocked
    grid.age[row, column] = 0.0
    assert clear_along(grid, free, course, pose, 0.6)[1], "it was seen, and is not drivable"
    assert clear_along(grid, free, course, pose, 0.45) == (RELIABLE, False)


def test_one_that_is_beside_the_way_comes_back_to_it_before_what_is_there() -> None:
    grid, pose = LocalGrid(), Pose(0.0, 1.5, 0.0)
    grid.move(pose, 1.0)
    free = np.ones_like(grid.known)
    ((row,), (column,), _) = grid.cells(np.array([[4.05, 0.05]]))
    free[row, column] = False
    found, _ = clear_along(grid, free, course_of((-5.0, 0.0), (9.0, 0.0), pose=pose), pose, 0.6)
    assert 4.0 < found < 5.0, "its own way there is longer"


@given(st.lists(PLACES, max_size=6), PLACES, st.floats(-720, 720))
def test_any_route_has_a_way_of_finite_places_or_none(
    points: list[tuple[float, float]], place: tuple[float, float], heading: float
) -> None:
    found = ahead_of(tuple(points), Pose(*place, heading))
    if found is not None:
        assert found.shape == (round(AHEAD / CELL), 2)
        assert np.isfinite(found).all()
        assert np.hypot(*np.diff(found, axis=0).T).max() < CELL + 1e-6
