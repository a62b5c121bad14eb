"""Where pixels meet the ground: signs, the way there and back, and the simulated field's own camera."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.ground import GroundCamera, Lens
from companion.sim.field.lens import LensMount, SimulatedLens
from companion.sim.field.trail import TrailPose

SIMULATED = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3)


def place(camera: GroundCamera, ahead: float, left: float) -> tuple[float, float]:
    """Where a point of the ground appears."""
    x, y = camera.to_picture(np.array([[ahead, left]]))[0]
    return float(x), float(y)


@pytest.mark.parametrize(("height", "tilt"), [(1.0, 7.0), (0.45, 15.0)])
def test_the_simulated_cameras_pixels_meet_the_ground_where_it_says(height: float, tilt: float) -> None:
    lens = SimulatedLens(320, 240, LensMount(height, math.radians(tilt)))
    camera = GroundCamera.pinhole(height, tilt, 75.0, 4 / 3)
    for ahead, left in ((2.0, 0.0), (5.0, 1.5), (9.0, -3.0)):
        column, row, _ = lens.project(TrailPose(0.0, 0.0, 0.0), ahead, left)
        assert place(camera, ahead, left) == pytest.approx((column / 320, row / 240), abs=1e-6)
    row = 200
    there = np.array([[lens.forward[row - lens.horizon, 40], lens.left[row - lens.horizon, 40]]])
    assert camera.to_picture(there)[0] == pytest.approx((40.5 / 320, 200.5 / 240), abs=1e-4)


def test_it_agrees_with_the_row_and_width_of_a_vehicle_that_does_not_lean() -> None:
    camera = GroundCamera.pinhole(0.8, 12.0, 70.0, 1.5, front=0.4)
    assert place(camera, 3.4, 0.0)[1] == pytest.approx(camera.row(3.0))
    left, right = place(camera, 3.4, 0.5), place(camera, 3.4, -0.5)
    assert right[0] - left[0] == pytest.approx(camera.width(1.0, 3.0))
    assert camera.distance(camera.row(3.0)) == pytest.approx(3.0)


def test_a_nose_that_goes_up_lowers_the_ground_in_the_picture_and_is_the_same_as_less_tilt() -> None:
    up = SIMULATED.leaning(2.0, 0.0)
    assert place(up, 5.0, 0.0)[1] > place(SIMULATED, 5.0, 0.0)[1]
    assert place(up, 5.0, 1.0) == pytest.approx(place(GroundCamera.pinhole(1.0, 5.0, 75.0, 4 / 3), 5.0, 1.0))


def test_a_right_side_that_goes_down_raises_the_right_of_the_picture() -> None:
    down = SIMULATED.leaning(0.0, 5.0)
    assert place(down, 4.0, -2.0)[1] < place(SIMULATED, 4.0, -2.0)[1]
    assert place(down, 4.0, 2.0)[1] > place(SIMULATED, 4.0, 2.0)[1]


def test_a_mount_that_is_rolled_is_the_same_as_a_vehicle_that_is_where_the_camera_looks_level() -> None:
    rolled = GroundCamera(Lens.of_view(60.0, 1.333), 1.0, 0.0, roll=4.0)
    level = GroundCamera(Lens.of_view(60.0, 1.333), 1.0, 0.0)
    assert place(rolled, 3.0, 1.0) == pytest.approx(place(level.leaning(0.0, 4.0), 3.0, 1.0))


def test_a_camera_that_looks_to_the_right_sees_what_lies_there_in_its_middle() -> None:
    aside = GroundCamera(Lens.of_view(60.0, 1.333), 1.0, 10.0, heading=30.0)
    ahead, right = 5.0 * math.cos(math.radians(30)), 5.0 * math.sin(math.radians(30))
    assert place(aside, ahead, -right)[0] == pytest.approx(0.5)


def test_what_is_behind_the_lens_or_above_the_horizon_has_no_place() -> None:
    assert math.isnan(place(SIMULATED, -3.0, 0.0)[0])
    assert np.isnan(SIMULATED.to_ground(np.array([[0.5, 0.1]]))).all()


CAMERAS = st.builds(
    GroundCamera,
    lens=st.builds(Lens, *[st.floats(0.3, 2.0)] * 2, *[st.floats(0.4, 0.6)] * 2),
    height=st.floats(0.1, 4),
    tilt=st.floats(-5, 60),
    roll=st.floats(-10, 10),
    heading=st.floats(-30, 30),
    pitch=st.floats(-10, 10),
    bank=st.floats(-10, 10),
)


@given(CAMERAS, st.floats(0.5, 20), st.floats(-5, 5))
@settings(max_examples=100)
def test_a_point_of_the_ground_comes_back_from_the_picture(
    camera: GroundCamera, ahead: float, left: float
) -> None:
    seen = camera.to_picture(np.array([[ahead, left]]))
    if np.isfinite(seen).all() and np.abs(seen).max() < 50.0:
        assert camera.to_ground(seen)[0] == pytest.approx((ahead, left), rel=1e-5, abs=1e-5)
