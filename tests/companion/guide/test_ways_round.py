"""A vehicle that follows its plans passes what leaves room, and stops before what does not."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.frame import Pose
from anytraverse.grid import LocalGrid
from companion.guide.arcs import plan
from tests.companion.guide.rides import BLIND, CAMERA, OUTLINE, ROUTE, Trail, ride

DRUM = 9.0
"""m ahead of the lens."""
RADIUS = 0.29


@pytest.mark.slow
@pytest.mark.parametrize("aside", [-0.5, 0.0, 0.25])
@pytest.mark.parametrize(("half", "hertz"), [(2.4, 10), (1.5, 5)])
def test_a_drum_that_leaves_room_is_passed_and_the_way_taken_up_again(
    half: float, hertz: float, aside: float
) -> None:
    ridden = ride(Trail(half, ((DRUM, aside, RADIUS),)), hertz, 9.0)
    assert ridden.pose.x > DRUM + 2.5
    assert ridden.drum > 0.15
    assert ridden.edge > 0.15
    assert abs(ridden.pose.y) < 0.3
    assert abs(ridden.pose.heading) < 15.0


@pytest.mark.parametrize("trail", [Trail(2.4, wall=6.0), Trail(1.3, ((6.0, 0.0, RADIUS),))])
def test_before_what_leaves_no_room_it_stops(trail: Trail) -> None:
    ridden = ride(trail, 5, 6.0)
    assert ridden.plans[-1].arcs == ()
    assert ridden.plans[-1].route_clear < 1.3
    assert min(ridden.drum, ridden.edge) > 0.1
    for made in ridden.plans[2:]:
        assert made.clear <= max(0.0, 6.0 - made.pose.x - OUTLINE.front)


@pytest.mark.slow
@pytest.mark.parametrize("stood", [0.0, 15.0])
@pytest.mark.parametrize(("away", "radius", "aside"), [(0.1, 0.25, 0.0), (0.5, 0.1, 0.0), (0.6, 0.25, 0.2)])
def test_what_steps_in_where_the_picture_does_not_show_its_foot_is_in_the_way(
    stood: float, away: float, radius: float, aside: float
) -> None:
    grid, at, pose = LocalGrid(), 0.0, Pose(0.0, 0.0, 0.0)
    for at in np.arange(0.2, 3.0 + stood, 0.2):
        pose = Pose(min(3.0, at), 0.0, 0.0)
        grid.update(Trail(2.4).maps(pose), CAMERA, pose, at)
    thing = (pose.x + OUTLINE.front + away + radius, aside, radius)
    for after in (0.2, 0.4, 0.6):
        grid.update(Trail(2.4, (thing,)).maps(pose), CAMERA, pose, at + after)
        made = plan(grid, ROUTE, OUTLINE, 4.0, at + after, blind=BLIND)
        assert made is not None
        assert made.arcs == ()
        assert made.route_clear <= away
    grid.update(Trail(2.4).maps(pose), CAMERA, pose, at + 0.8)
    made = plan(grid, ROUTE, OUTLINE, 4.0, at + 0.8, blind=BLIND)
    assert made is not None
    assert made.arcs, "it is gone"


def test_where_the_trail_is_free_it_keeps_to_its_middle() -> None:
    ridden = ride(Trail(1.5), 5, 5.0)
    assert abs(ridden.pose.y) < 0.05
    assert all(abs(curvature) < 0.1 for made in ridden.plans for curvature, _ in made.arcs)


def test_one_that_is_beside_its_way_comes_back_to_it() -> None:
    ridden = ride(Trail(2.4), 5, 7.0, start=Pose(0.0, 1.0, 10.0))
    assert abs(ridden.pose.y) < 0.25
    assert ridden.edge > 0.3
