"""What a plan promises of the ground along its arcs."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.frame import Pose
from anytraverse.grid import CELL, SIDE, LocalGrid
from anytraverse.ground import RELIABLE, GroundCamera
from companion.guide.arcs import MARGIN, TOUCHING, blind_of, plan
from companion.guide.plan import Outline, Plan, Route
from companion.guide.tree import STEP
from tests.companion.guide.rides import BLIND, CAMERA, OUTLINE, ROUTE, way

NAN, INF = math.nan, math.inf
HALF = OUTLINE.width / 2
FAR = 3.875
"""m, as of `Errand`."""
START = Pose(0.05, 0.05, 0.0)
"""In the middle of a cell, so that the grid has a mirror."""
DISCS = st.lists(
    st.tuples(st.floats(-1.0, 6.0), st.floats(-3.0, 3.0), st.floats(0.05, 0.8), st.booleans()), max_size=8
)


def known(pose: Pose = START, discs: list[tuple[float, float, float, bool]] | None = None) -> LocalGrid:
    """Drivable ground but for discs: x and y in m from the vehicle, radius, and whether it is unknown."""
    grid = LocalGrid()
    grid.move(pose, 1.0)
    places = grid.to_vehicle(grid.places(*np.indices((SIDE, SIDE))))
    grid.age[np.hypot(places[..., 0], places[..., 1]) <= RELIABLE] = 0.0
    grid.share.fill(1.0)
    for x, y, radius, unknown in discs or []:
        inside = np.hypot(places[..., 0] - x, places[..., 1] - y) <= radius
        grid.age[inside] = INF if unknown else 0.0
        grid.share[inside] = 0.0
    grid.age[0] = INF
    return grid


def route(pose: Pose, corridor: float = 3.0, turn: float = 0.0) -> Route:
    """A mission's way through the vehicle, turned from its nose by so many degrees."""
    heading = math.radians(pose.heading + turn)
    c, s = math.cos(heading), math.sin(heading)
    return Route(tuple((pose.x + c * x, pose.y + s * x) for x in (-3.0, 0.0, 2.0, 30.0)), corridor)


def made(grid: LocalGrid, told: Route = ROUTE, outline: Outline = OUTLINE, **given: float) -> Plan:
    found = plan(grid, told, outline, given.get("far", FAR), 1.0, blind=given.get("blind", BLIND))
    assert found is not None
    return found


def nearest(grid: LocalGrid, points: np.ndarray, outline: Outline) -> float:
    """m from points of odometry to the nearest cell that is not free, and not below the picture."""
    places = grid.places(*np.indices((SIDE, SIDE)))
    around = grid.to_vehicle(places)
    side = outline.width / 2 + MARGIN + CELL
    below = (np.abs(around[..., 1]) <= side) & (np.abs(around[..., 0]) <= BLIND)
    closed = grid.blocked | ~(grid.known | below)
    inner = closed & np.roll(closed, 1, 0) & np.roll(closed, -1, 0) & np.roll(closed, 1, 1)
    rims = places[closed & ~(inner & np.roll(closed, -1, 1))]
    away = np.maximum(np.abs(rims - points[:, np.newaxis]) - CELL / 2, 0.0)
    return float(np.hypot(away[..., 0], away[..., 1]).min())


@settings(max_examples=40, deadline=None)
@given(
    DISCS,
    st.builds(Pose, st.floats(-30, 30), st.floats(-30, 30), st.floats(-720, 720)),
    st.floats(-50, 50),
    st.builds(Outline, st.floats(0.3, 1.2), st.floats(0.0, 1.0), st.floats(0.5, 4.0)),
)
def test_all_ground_that_the_body_comes_over_on_the_arcs_is_known_to_be_drivable(
    discs: list[tuple[float, float, float, bool]], pose: Pose, turn: float, outline: Outline
) -> None:
    grid = known(pose, discs)
    found = made(grid, route(pose, turn=turn), outline)
    assert 0.0 <= found.route_clear <= RELIABLE
    assert 0.0 <= found.clear <= RELIABLE
    assert (found.clear == 0.0) == (not found.arcs)
    if found.arcs:
        assert sum(length for _, length in found.arcs) == pytest.approx(found.clear)
        assert all(abs(curvature) <= 1.0 / outline.radius + 1e-9 for curvature, _ in found.arcs)
        points = way(found)
        assert nearest(grid, points, outline) >= outline.width / 2 + min(found.gap, TOUCHING - CELL) - 0.01
        steps = np.diff(points, axis=0)
        noses = steps / np.hypot(*steps.T)[:, np.newaxis] * max(0.0, outline.front - outline.width / 2)
        assert nearest(grid, points[1:] + noses, outline) >= outline.width / 2 - 0.01


@settings(max_examples=25, deadline=None)
@given(DISCS)
def test_a_mirrored_grid_has_a_mirrored_plan(discs: list[tuple[float, float, float, bool]]) -> None:
    told = route(START)
    one = made(known(discs=discs), told)
    other = made(known(discs=[(x, -y, radius, unknown) for x, y, radius, unknown in discs]), told)
    assert other.route_clear == pytest.approx(one.route_clear, abs=CELL)
    enough = 3.0
    assert min(other.clear, enough) == pytest.approx(min(one.clear, enough), abs=3 * STEP)


def test_free_ground_is_driven_straight_along_the_route() -> None:
    found = made(known(), route(START))
    assert [curvature for curvature, _ in found.arcs] == [0.0, 0.0]
    assert found.clear > 5.0
    assert found.route_clear == pytest.approx(RELIABLE - OUTLINE.front, abs=0.2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_stands_on_one_side_is_passed_on_the_other(side: float) -> None:
    found = made(known(discs=[(3.0, 0.3 * side, 0.3, False)]), route(START))
    assert found.route_clear == pytest.approx(2.4, abs=0.2)
    assert found.clear > 4.0
    assert side * float(found.arcs[0][0]) < 0.0
    assert found.gap >= MARGIN - CELL - 0.01


def test_the_side_of_the_last_plan_is_kept_to() -> None:
    grid = known(discs=[(3.5, 0.0, 0.3, False)])
    for side in (1.0, -1.0):
        before = made(known(discs=[(3.5, -0.4 * side, 0.3, False)]), route(START))
        kept = plan(grid, route(START), OUTLINE, FAR, 1.1, blind=BLIND, before=before)
        assert kept is not None
        assert kept.arcs[0][0] * side > 0.0
        late = plan(grid, route(START), OUTLINE, FAR, 3.0, blind=BLIND, before=before)
        assert late == made(grid, route(START))._replace(at=3.0), "an old plan says nothing"


@pytest.mark.parametrize("unknown", [True, False])
def test_where_no_room_is_the_way_ends_before_it(unknown: bool) -> None:
    wall = [(3.0, 0.3 * number, 0.25, unknown) for number in range(-20, 21)]
    found = made(known(discs=wall), route(START))
    assert found.route_clear == pytest.approx(3.0 - 0.25 - OUTLINE.front, abs=0.25)
    assert found.clear <= found.route_clear


def test_nothing_leaves_the_corridor_though_it_is_free() -> None:
    grid = known(discs=[(3.0, 0.0, 0.4, False)])
    assert made(grid, route(START)).clear > 4.0
    assert made(grid, route(START, corridor=0.5)).clear < 3.0
    far = Route(((0.0, 50.0), (40.0, 50.0)), 3.0)
    assert made(grid, far).arcs == ()


def test_ground_below_the_picture_counts_as_free_unless_something_is_known_there() -> None:
    unseen = [(0.0, 0.0, BLIND, True)]
    assert made(known(discs=unseen), route(START)).clear > 5.0
    assert made(known(discs=unseen), route(START), blind=INF).arcs == ()
    assert made(known(discs=[*unseen, (1.0, 0.0, 0.2, False)]), route(START)).clear < 0.7


def test_a_vehicle_that_stands_nearer_than_its_margin_may_leave_but_come_no_nearer() -> None:
    grid = known(discs=[(0.0, HALF + 0.35, 0.15, False)])
    found = made(grid, route(START))
    assert found.clear > 4.0
    assert 0.0 < found.gap < MARGIN - CELL
    touching = known(discs=[(0.0, HALF, 0.2, False)])
    assert made(touching, route(START)).arcs == ()


@pytest.mark.parametrize(
    "points",
    [(), ((0.0, 0.0),), ((0.0, 0.0), (0.0, 0.0)), ((0.0, NAN), (5.0, 0.0)), ((0.0, 0.0), (1e30, INF))],
)
def test_a_route_that_leads_nowhere_has_no_plan(points: tuple[tuple[float, float], ...]) -> None:
    assert plan(known(), Route(points, 3.0), OUTLINE, FAR, 1.0, blind=BLIND) is None


@pytest.mark.parametrize("wrong", [NAN, INF, -1.0, 0.0])
def test_impossible_vehicles_have_no_plan(wrong: float) -> None:
    grid = known()
    for outline in (OUTLINE._replace(width=wrong), OUTLINE._replace(radius=wrong)):
        assert plan(grid, ROUTE, outline, FAR, 1.0, blind=BLIND) is None
    if wrong != 0.0:
        assert plan(grid, ROUTE, OUTLINE._replace(front=wrong), FAR, 1.0, blind=BLIND) is None
        assert plan(grid, ROUTE, OUTLINE, wrong, 1.0, blind=BLIND) is None
        assert plan(grid, ROUTE._replace(corridor=wrong), OUTLINE, FAR, 1.0, blind=BLIND) is None
    assert plan(grid, ROUTE, OUTLINE, FAR, 1.0, blind=NAN) is not None


def test_a_grid_without_a_pose_has_no_plan_and_one_that_knows_nothing_no_arcs() -> None:
    grid = LocalGrid()
    assert plan(grid, ROUTE, OUTLINE, FAR, 1.0, blind=BLIND) is None
    grid.move(START, 1.0)
    found = made(grid)
    assert found.arcs == ()
    assert found.route_clear < BLIND


def test_a_camera_that_sees_no_ground_has_no_ground_below_its_picture() -> None:
    assert blind_of(GroundCamera.pinhole(1.0, -40.0, 75.0, 4 / 3, 0.3), 0.6) == INF
    assert 0.3 < blind_of(CAMERA, 0.6) < 2.0


def test_a_very_long_route_takes_no_longer() -> None:
    grid, points = known(), tuple((0.1 * number, math.sin(number)) for number in range(100_000))
    began = time.process_time()
    assert plan(grid, Route(points, 3.0), OUTLINE, FAR, 1.0, blind=BLIND) is not None
    assert time.process_time() - began < 0.5
