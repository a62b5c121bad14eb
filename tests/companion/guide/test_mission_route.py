"""The mission's way ahead in the axes of odometry: x north, y WEST, whatever comes in."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from anytraverse.frame import Pose
from companion.guide import legs
from companion.guide.plan import Route
from companion.guide.route import MissionRoute, route
from companion.vehicle.mission import MissionItem
from companion.vehicle.motion import MotionReport
from companion.vehicle.state import METRES_PER_DEGREE, Mission, MissionState, Vehicle

HERE = (47.0, 8.0)
SHRINKS = math.cos(math.radians(HERE[0]))
START = Pose(0.0, 0.0, 0.0)
Point = tuple[float, float]


def place(north: float, east: float) -> legs.Place:
    return (
        HERE[0] + north / METRES_PER_DEGREE,
        HERE[1] + east / METRES_PER_DEGREE / SHRINKS,
    )


def at(seq: int, north: float, east: float, *, delay: float = 0.0, command: int = 16) -> MissionItem:
    return MissionItem(seq, command, 3, delay, *place(north, east))


def does(seq: int, command: int, value: float = 0.0) -> MissionItem:
    return MissionItem(seq, command, 0, value, 0.0, 0.0)


def through(*points: Point) -> tuple[MissionItem, ...]:
    """Home, and waypoints (north, east) in m."""
    return (at(0, -50.0, 70.0), *(at(seq, *point) for seq, point in enumerate(points, 1)))


def near(found: Route | None, *points: Point) -> bool:
    assert found is not None
    return len(found.points) == len(points) and all(
        math.dist(one, other) < 0.01 for one, other in zip(found.points, points, strict=True)
    )


def test_a_leg_north_leads_along_x() -> None:
    items = through((0.0, 0.0), (20.0, 0.0))
    assert near(route(items, 2, place(5.0, 0.0), Pose(5.0, 0.0, 0.0), 3.0), (0.0, 0.0), (20.0, 0.0))


def test_a_leg_east_leads_along_negative_y() -> None:
    items = through((0.0, 0.0), (0.0, 20.0))
    assert near(route(items, 2, place(1.0, 5.0), Pose(1.0, -5.0, 270.0), 3.0), (0.0, 0.0), (0.0, -20.0))


def test_a_leg_southwest_leads_along_negative_x_and_positive_y() -> None:
    items = through((0.0, 0.0), (-10.0, -10.0))
    found = route(items, 2, place(0.0, 0.0), Pose(100.0, 200.0, 135.0), 3.0)
    assert near(found, (100.0, 200.0), (90.0, 210.0))


def test_a_leg_over_the_date_line_is_short() -> None:
    items = (
        does(0, 16),
        MissionItem(1, 16, 3, 0.0, 60.0, 179.9999),
        MissionItem(2, 16, 3, 0.0, 60.0, -179.9999),
    )
    east = 0.0002 * METRES_PER_DEGREE * 0.5
    assert near(route(items, 2, (60.0, 179.9999), Pose(0.0, 0.0, 270.0), 3.0), (0.0, 0.0), (0.0, -east))


def test_the_first_leg_begins_where_the_vehicle_was_when_it_began() -> None:
    items = through((20.0, 0.0))
    pose = Pose(7.0, -1.0, 0.0)
    assert near(route(items, 1, place(7.0, 1.0), pose, 3.0), (7.0, -1.0), (20.0, 0.0))
    assert near(route(items, 1, place(7.0, 1.0), pose, 3.0, place(2.0, 0.0)), (2.0, 0.0), (20.0, 0.0))


def test_an_item_that_a_jump_leads_to_has_no_known_start() -> None:
    items = (*through((0.0, 0.0), (20.0, 0.0), (20.0, 20.0)), does(4, 177, 2.0))
    assert legs.start_of(items, 2) is None
    assert legs.start_of(items, 3) == place(20.0, 0.0)
    assert legs.start_of(through((0.0, 0.0), (20.0, 0.0)), 2) == place(0.0, 0.0)


def test_the_way_goes_on_through_plain_waypoints_for_thirty_metres() -> None:
    items = through(*((10.0 * step, 0.0) for step in range(10)))
    found = route(items, 2, place(4.0, 1.0), Pose(4.0, -1.0, 0.0), 3.0)
    assert near(found, *((10.0 * step, 0.0) for step in range(4)), (34.0, 0.0))
    far = through((0.0, 0.0), (500.0, 0.0), (510.0, 0.0))
    assert near(route(far, 2, place(4.0, 1.0), Pose(4.0, -1.0, 0.0), 3.0), (0.0, 0.0), (34.0, 0.0))


def test_it_ends_at_the_last_waypoint() -> None:
    items = through((0.0, 0.0), (10.0, 0.0), (20.0, 0.0))
    assert near(
        route(items, 2, place(4.0, 0.0), Pose(4.0, 0.0, 0.0), 3.0), (0.0, 0.0), (10.0, 0.0), (20.0, 0.0)
    )


@pytest.mark.parametrize(
    "between",
    [
        does(3, 178, 1.0),  # DO_CHANGE_SPEED
        does(3, 177, 1.0),  # DO_JUMP
        does(3, 93, 5.0),  # NAV_DELAY
        at(3, 15.0, 0.0, command=19),  # NAV_LOITER_TIME
        at(3, 15.0, 0.0, command=82),  # NAV_SPLINE_WAYPOINT
        at(3, 15.0, 0.0, delay=2.0),
        MissionItem(3, 16, 1, 0.0, *place(15.0, 0.0)),  # a local frame
        MissionItem(3, 16, 3, 0.0, 0.0, 0.0),
    ],
)
def test_what_auto_must_do_ends_the_way_at_the_waypoint_before(between: MissionItem) -> None:
    items = (*through((0.0, 0.0), (10.0, 0.0)), between, at(4, 20.0, 0.0), at(5, 25.0, 0.0))
    assert near(route(items, 2, place(4.0, 0.0), Pose(4.0, 0.0, 0.0), 3.0), (0.0, 0.0), (10.0, 0.0))
    assert legs.passed(items, 2, place(11.0, 0.0), 3.0, HERE) == 2
    assert legs.passed(items, 1, place(11.0, 0.0), 3.0, place(-5.0, 0.0)) == 2


def test_the_way_to_a_waypoint_with_a_delay_ends_there() -> None:
    items = (*through((0.0, 0.0)), at(2, 10.0, 0.0, delay=3.0), at(3, 20.0, 0.0), at(4, 30.0, 0.0))
    assert near(route(items, 2, place(4.0, 0.0), Pose(4.0, 0.0, 0.0), 3.0), (0.0, 0.0), (10.0, 0.0))
    assert legs.passed(items, 2, place(11.0, 0.0), 3.0, HERE) == 2


def test_a_leg_begins_at_the_waypoint_before_what_auto_does_on_the_way() -> None:
    items = (*through((0.0, 0.0)), does(2, 178), does(3, 93), at(4, 20.0, 0.0))
    assert legs.start_of(items, 4) == place(0.0, 0.0)
    circle = (*through((0.0, 0.0)), at(2, 10.0, 0.0, command=18), at(3, 20.0, 0.0))
    assert legs.start_of(circle, 3) is None


@pytest.mark.parametrize("current", [-1, 0, 3, 65535])
def test_where_the_current_item_is_no_waypoint_there_is_no_way(current: int) -> None:
    items = (*through((0.0, 0.0), (10.0, 0.0)), does(3, 177, 1.0))
    assert route(items, current, HERE, START, 3.0) is None
    assert legs.passed(items, current, HERE, 3.0, HERE) == current


def test_a_waypoint_two_kilometres_away_is_too_far() -> None:
    assert route(through((1990.0, 0.0)), 1, HERE, START, 3.0) is not None
    assert route(through((2010.0, 0.0)), 1, HERE, START, 3.0) is None


CORNER = through((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (20.0, 40.0))
"""North, and then a right angle to the east."""


@pytest.mark.parametrize(
    ("north", "east", "item"),
    [
        (19.0, 0.0, 2),
        (19.0, 0.9, 2),
        (19.0, 1.1, 3),  # beyond the plane that halves the corner
        (21.5, -1.4, 3),
        (21.0, -1.1, 2),
        (20.5, 19.0, 3),
        (20.0, 20.1, 4),
        (20.0, 45.0, 2),  # too far from the leg that begins there
        (24.9, 5.0, 3),
        (25.1, 5.0, 2),  # outside the corridor and its slack
        (0.0, 5.0, 2),
    ],
)
def test_a_waypoint_is_passed_beyond_the_plane_that_halves_its_legs(
    north: float, east: float, item: int
) -> None:
    assert legs.passed(CORNER, 2, place(north, east), 3.0, HERE) == item


def test_where_the_way_turns_back_the_first_leg_must_be_driven_to_its_end() -> None:
    items = through((0.0, 0.0), (20.0, 0.0), (0.0, 2.0), (-20.0, 2.0))
    assert legs.passed(items, 2, place(5.0, 1.5), 3.0, HERE) == 2
    assert legs.passed(items, 2, place(20.1, 0.5), 3.0, HERE) == 3


def test_two_waypoints_at_one_place_are_passed_together() -> None:
    items = through((0.0, 0.0), (20.0, 0.0), (20.0, 0.0), (40.0, 0.0))
    assert legs.passed(items, 2, place(21.0, 0.0), 3.0, HERE) == 4
    found = route(items, 2, place(15.0, 0.0), Pose(15.0, 0.0, 0.0), 3.0)
    assert near(found, (0.0, 0.0), (20.0, 0.0), (40.0, 0.0))


def test_at_its_own_place_a_waypoint_is_no_way() -> None:
    assert route(through((0.0, 0.0)), 1, HERE, START, 3.0) is None


NUMBER = some.floats(allow_nan=True, allow_infinity=True)
ITEM = some.builds(
    MissionItem,
    some.integers(0, 9),
    some.sampled_from([16, 16, 16, 17, 19, 82, 93, 177, 178, 0, 65535]),
    some.sampled_from([0, 3, 6, 11, 1, 255]),
    some.one_of(some.just(0.0), some.floats(-5.0, 12.0)),
    some.one_of(some.floats(46.999, 47.001), some.floats(-215.0, 215.0), NUMBER),
    some.one_of(some.floats(7.999, 8.001), some.floats(-215.0, 215.0), NUMBER),
)


@pytest.mark.slow
@given(
    some.lists(ITEM, max_size=9),
    some.integers(-2, 10),
    some.tuples(
        some.one_of(some.floats(46.999, 47.001), some.floats(-90.0, 90.0)), some.floats(-180.0, 180.0)
    ),
    some.builds(Pose, NUMBER, NUMBER, NUMBER),
    some.floats(0.0, 50.0),
)
@settings(max_examples=400, deadline=None)
def test_whatever_comes_in_a_route_is_none_or_made_of_numbers(
    items: list[MissionItem], current: int, position: legs.Place, pose: Pose, corridor: float
) -> None:
    found = route(items, current, position, pose, corridor)
    if found is not None:
        assert len(found.points) >= 2
        assert all(math.isfinite(one) for point in found.points for one in point)
        assert legs.waypoint(items, current) is not None
    assert (
        current <= legs.passed(items, current, position, corridor, position) <= max(current, len(items) - 1)
    )


POINT = some.tuples(some.floats(-200.0, 200.0), some.floats(-200.0, 200.0))


@given(some.lists(POINT, min_size=2, max_size=6), POINT, POINT)
@settings(max_examples=200, deadline=None)
def test_the_way_stays_where_it_is_however_the_vehicle_and_its_axes_are_moved(
    points: list[Point], spot: Point, shift: Point
) -> None:
    items = through(*points)
    pose = Pose(spot[0], -spot[1], 90.0)
    one = route(items, 2, place(*spot), pose, 3.0)
    moved = route(items, 2, place(*spot), Pose(pose.x + shift[0], pose.y + shift[1], 0.0), 3.0)
    assert (one is None) == (moved is None)
    if one is None or moved is None:
        return
    for point, other in zip(one.points, moved.points, strict=True):
        assert math.dist((point[0] + shift[0], point[1] + shift[1]), other) < 1e-6
    wanted = [(north, -east) for north, east in points]
    # All but the last, which may be cut, are the waypoints themselves; the flat earth costs centimetres.
    for point, other in zip(one.points[:-1], [wanted[0], *_distinct(wanted)[1:]], strict=False):
        assert math.dist(point, other) < 0.05


def _distinct(points: list[Point]) -> list[Point]:
    kept = points[:1]
    for point in points[1:]:
        if math.dist(kept[-1], point) > 0.01:
            kept.append(point)
    return kept


@given(some.lists(POINT, min_size=2, max_size=5, unique=True), POINT, some.sampled_from([90, 180, 270]))
@settings(max_examples=200, deadline=None)
def test_a_mission_that_is_turned_is_a_way_that_is_turned(
    points: list[Point], spot: Point, degrees: int
) -> None:
    sine, cosine = round(math.sin(math.radians(degrees))), round(math.cos(math.radians(degrees)))

    def turned(point: Point) -> Point:
        return cosine * point[0] - sine * point[1], sine * point[0] + cosine * point[1]

    one = route(through(*points), 2, place(*spot), Pose(0.0, 0.0, 0.0), 3.0)
    other = route(through(*map(turned, points)), 2, place(*turned(spot)), Pose(0.0, 0.0, 0.0), 3.0)
    if one is None or other is None or len(one.points) != len(other.points):
        return  # a last piece shorter than a centimetre
    for (x, y), found in zip(one.points, other.points, strict=True):
        north, east = turned((x, -y))
        assert math.dist((north, -east), found) < 0.1


def motion(when: float, pose: Pose | None, speed: float = 2.0) -> MotionReport:
    return MotionReport(when, 0.0, 0.0, 0.0, 0.0, pose, speed, 0.0)


def vehicle(when: float, north: float, *, item: int = 2, x: float | None = None) -> Vehicle:
    """One that drives north at 2 m/s. x: by odometry, the same as `north` unless said."""
    return Vehicle(
        1,
        3,
        10,
        armed=True,
        heard_at=when,
        position=(*place(north, 0.0), 0.0),
        speed=2.0,
        position_at=when,
        motion=motion(when, Pose(north if x is None else x, 0.0, 0.0)),
        mission=Mission(item, 3, MissionState.ACTIVE, 0, when),
    )


ITEMS = through((0.0, 0.0), (20.0, 0.0), (40.0, 0.0))


def test_the_route_is_laid_by_the_pose_at_the_time_of_the_position() -> None:
    ways = MissionRoute(3.0)
    ways.update(vehicle(10.0, 4.0, x=104.0), ITEMS, 10.0)
    later = replace(vehicle(10.2, 4.0, x=104.4), position_at=10.0)
    assert near(ways.update(later, ITEMS, 10.2), (100.0, 0.0), (120.0, 0.0), (134.0, 0.0))
    # The position is of 10.25 s, the motion of 10.2 s: since then it has driven 0.1 m.
    between = replace(later, position=(*place(4.5, 0.0), 0.0), position_at=10.25)
    assert near(ways.update(between, ITEMS, 10.3), (100.0, 0.0), (120.0, 0.0), (134.5, 0.0))
    assert ways.why == ""


def test_why_there_is_no_route_is_said() -> None:
    ways = MissionRoute(3.0)
    known = vehicle(10.0, 4.0)
    for given_vehicle, items, now, why in (
        (known, None, 10.0, "the mission's items are not known"),
        (known, (), 10.0, "the mission's items are not known"),
        (None, ITEMS, 10.0, "the current item is not known"),
        (replace(known, mission=None), ITEMS, 10.0, "the current item is not known"),
        (replace(known, position=None), ITEMS, 10.0, "no position"),
        (known, ITEMS, 11.6, "no position"),
        (known, ITEMS, 15.1, "the current item is not known"),
        (replace(known, motion=None), ITEMS, 10.0, "no odometry"),
        (replace(known, motion=motion(10.0, None)), ITEMS, 10.0, "no odometry"),
        (replace(known, mission=Mission(0, 3, MissionState.ACTIVE, 0, 10.0)), ITEMS, 10.0, "is no waypoint"),
    ):
        assert ways.update(given_vehicle, items, now) is None
        assert why in ways.why
    assert ways.update(known, ITEMS, 10.0) is not None


def test_an_odometry_that_begins_anew_has_no_route_until_the_next_position() -> None:
    ways = MissionRoute(3.0)
    assert ways.update(vehicle(10.0, 4.0), ITEMS, 10.0) is not None
    anew = replace(vehicle(10.5, 5.0, x=1005.0), position=(*place(4.0, 0.0), 0.0), position_at=10.0)
    assert ways.update(anew, ITEMS, 10.5) is None
    assert ways.why == "no odometry"
    found = ways.update(vehicle(10.7, 5.4, x=1005.4), ITEMS, 10.7)
    assert near(found, (1000.0, 0.0), (1020.0, 0.0), (1035.4, 0.0))


def test_the_first_leg_keeps_its_start_while_the_vehicle_drives_on() -> None:
    ways = MissionRoute(3.0)
    for step in range(5):
        found = ways.update(vehicle(10.0 + step, -9.0 + step, item=1), ITEMS, 10.0 + step)
        assert found is not None
        assert math.dist(found.points[0], (-9.0, 0.0)) < 0.01
    assert ways.item == 1
    ways.update(vehicle(15.0, 0.5, item=1), ITEMS, 15.0)
    assert ways.item == 2


def test_what_was_passed_without_auto_stays_passed_and_the_way_goes_on_from_there() -> None:
    items = through(*((20.0 * step, 0.0) for step in range(6)))
    ways = MissionRoute(3.0)
    for step in range(60):
        found = ways.update(vehicle(10.0 + step, 4.0 + step, item=2), items, 10.0 + step)
        assert found is not None
        ahead = found.points[-1][0] - (4.0 + step)
        assert ahead == pytest.approx(30.0, abs=0.01)
    assert ways.item == 5
    ways.update(vehicle(71.0, 64.0, item=2), items, 71.0)
    assert ways.item == 5


def beyond_a_waypoint() -> tuple[MissionRoute, tuple[MissionItem, ...]]:
    """One that has driven past waypoint 2 of a straight mission, which is still the current item."""
    items = through(*((20.0 * step, 0.0) for step in range(6)))
    ways = MissionRoute(3.0)
    for step in range(30):
        ways.update(vehicle(10.0 + step, 4.0 + step, item=2), items, 10.0 + step)
    assert ways.item == 3
    return ways, items


def test_what_was_passed_in_a_mission_is_not_passed_in_the_next_one() -> None:
    ways, _ = beyond_a_waypoint()
    assert ways.update(vehicle(40.1, 34.0, item=1), None, 40.1) is None, "another mission is being downloaded"
    assert ways.item == 1
    ways.update(vehicle(40.2, 34.0, item=1), through((0.0, 50.0), (0.0, 60.0)), 40.2)
    assert ways.item == 1


def test_what_was_passed_is_not_passed_once_a_human_has_driven() -> None:
    ways, items = beyond_a_waypoint()
    ways.update(replace(vehicle(40.0, 10.0, item=2), custom_mode=0), items, 40.0)
    assert ways.item == 2
    ways.update(vehicle(40.2, 10.0, item=2), items, 40.2)
    assert ways.item == 2


def test_an_item_that_somebody_sets_counts_though_no_position_comes() -> None:
    ways, items = beyond_a_waypoint()
    assert ways.update(replace(vehicle(40.0, 34.0, item=1), position=None), items, 40.0) is None
    assert ways.item == 1


def test_a_waypoint_to_which_somebody_sends_the_vehicle_back_is_not_passed() -> None:
    items = through(*((20.0 * step, 0.0) for step in range(6)))
    ways = MissionRoute(3.0)
    ways.update(vehicle(10.0, 64.0, item=5), items, 10.0)
    for step in range(20):
        ways.update(vehicle(11.0 + step, 64.0 - step, item=3), items, 11.0 + step)
        assert ways.item == 3
    ways.update(vehicle(31.0, 38.0, item=3), items, 31.0)
    ways.update(vehicle(32.0, 41.0, item=3), items, 32.0)
    assert ways.item == 4


def test_how_near_a_waypoint_is_counts_where_it_may_be_passed() -> None:
    items = through(*((20.0 * step, 0.0) for step in range(3)))
    ways = MissionRoute(3.0)
    assert ways.nears == math.inf
    ways.update(vehicle(10.0, 15.0, item=2), items, 10.0)
    assert ways.nears == pytest.approx(5.0, abs=0.01)
    ways.update(vehicle(11.0, 21.0, item=2), items, 11.0)
    assert (ways.item, ways.nears) == (3, math.inf), "the last one is the mission's own"


def test_the_last_waypoint_is_never_passed() -> None:
    ways = MissionRoute(3.0)
    for step in range(60):
        ways.update(vehicle(10.0 + step, 4.0 + step, item=2), ITEMS, 10.0 + step)
    assert ways.item == 3
