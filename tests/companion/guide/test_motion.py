"""Tests of following the arcs of a plan."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.frame import Pose
from companion.guide.motion import NARROW, STAND, follow, moved, passing_speed
from companion.guide.plan import Plan

STRAIGHT = ((0.0, 6.0),)
ORIGIN = Pose(0.0, 0.0, 0.0)
numbers = st.floats(-10.0, 10.0)


def plan(arcs: tuple[tuple[float, float], ...], pose: Pose = ORIGIN, clear: float = 6.0) -> Plan:
    return Plan(0.0, pose, 3.0, route_blocked=True, arcs=arcs, clear=clear, gap=2.0)


def test_a_straight_way_is_driven_straight() -> None:
    assert follow(plan(STRAIGHT), Pose(0.0, 0.0, 0.0), 1.0, 2.26, 1.5) == (1.0, 0.0)


def test_beside_the_way_it_turns_towards_it() -> None:
    right, left = Pose(1.0, -0.3, 0.0), Pose(1.0, 0.3, 0.0)
    assert follow(plan(STRAIGHT), right, 1.0, 2.26, 1.5).yaw_rate > 0.0
    assert follow(plan(STRAIGHT), left, 1.0, 2.26, 1.5).yaw_rate < 0.0


def test_the_speed_falls_as_the_clear_way_gets_less_without_a_newer_plan() -> None:
    speeds = [follow(plan(STRAIGHT), Pose(x, 0.0, 0.0), 1.5, 2.26, 1.5).speed for x in (0.0, 3.0, 4.5, 5.4)]
    assert speeds == pytest.approx([1.5, (3.0 - 0.5) / 2.26, (1.5 - 0.5) / 2.26, 0.0], abs=0.05)


def test_something_beside_the_vehicle_is_passed_slowly() -> None:
    near = plan(STRAIGHT)._replace(gap=NARROW - 0.1)
    assert follow(near, Pose(0.0, 0.0, 0.0), 1.5, 2.26, 1.5).speed == passing_speed(1.5) < 1.5


@given(
    st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(0.0, 4.0)), max_size=2),
    st.builds(Pose, numbers, numbers, st.floats(0.0, 360.0)),
    st.floats(0.0, 3.0),
    st.floats(0.0, 8.0),
)
def test_it_never_turns_tighter_than_the_vehicle_can(
    arcs: list[tuple[float, float]], pose: Pose, speed: float, clear: float
) -> None:
    target = follow(plan(tuple(arcs), clear=clear), pose, speed, 2.26, 1.5)
    assert 0.0 <= target.speed <= speed
    assert abs(math.radians(target.yaw_rate)) <= target.speed / 1.5 + 1e-9
    if not arcs:
        assert target == STAND


@given(st.floats(-0.9, 0.9), st.floats(0.0, 3.0), st.floats(0.0, 360.0))
def test_two_halves_of_an_arc_are_the_whole(curvature: float, way: float, heading: float) -> None:
    begin = Pose(1.0, 2.0, heading)
    halves, whole = moved(moved(begin, way / 2, curvature), way / 2, curvature), moved(begin, way, curvature)
    assert halves[:2] == pytest.approx(whole[:2], abs=1e-6)
    assert math.cos(math.radians(halves.heading - whole.heading)) == pytest.approx(1.0)


def test_from_a_vehicle_on_the_arcs_the_pursuit_stays_on_them() -> None:
    arcs, pose = ((0.4, 3.0), (-0.4, 3.0)), Pose(0.0, 0.0, 90.0)
    middle = moved(pose, 3.0, 0.4)
    way = [moved(pose, n / 20, 0.4) for n in range(60)] + [moved(middle, n / 20, -0.4) for n in range(60)]
    now, driven = pose, 0.0
    while (target := follow(plan(arcs, pose), now, 1.0, 2.26, 1.5)).speed > 0.0:
        now = moved(now, 0.02 * target.speed, math.radians(target.yaw_rate) / target.speed)
        driven += 0.02 * target.speed
        assert min(math.hypot(now.x - point.x, now.y - point.y) for point in way) < 0.15
    assert driven > 5.0
