"""The lines that show where a mount puts the ground: where they lie, what is cut, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.ground import GroundCamera, Lens
from anytraverse.ground_lines import GroundLine, ground_lines, horizon_row

SIMULATED = GroundCamera.pinhole(1.0, 7.0, 75.0, 4 / 3, front=0.6)


def of_kind(lines: tuple[GroundLine, ...], kind: str) -> list[GroundLine]:
    return [line for line in lines if line.kind == kind]


def test_a_metre_line_lies_so_far_ahead_of_the_front_and_not_of_the_lens() -> None:
    lines = of_kind(ground_lines(SIMULATED), "metre")
    assert [line.label for line in lines] == ["1 m", "2 m", "3 m", "4 m", "5 m", "6 m"]
    for metres, line in enumerate(lines, 1):
        assert line.start[1] == line.end[1] == pytest.approx(SIMULATED.row(metres))
        assert line.start[0] < line.end[0]


def test_the_sides_are_the_vehicles_width_apart_and_meet_at_the_horizon() -> None:
    left, right = of_kind(ground_lines(SIMULATED, 0.8), "side")
    assert (left.label, right.label) == ("", "0.8 m wide")
    far = SIMULATED.to_picture(np.array([[6.6, 0.4], [6.6, -0.4]]))
    assert [left.end, right.end] == [pytest.approx(tuple(far[0])), pytest.approx(tuple(far[1]))]
    assert max(left.start[1], right.start[1]) == pytest.approx(1.0)


def test_a_width_that_is_not_set_is_shown_as_an_assumed_metre() -> None:
    lines = ground_lines(SIMULATED)
    assert not of_kind(lines, "side")
    assert [line.label for line in of_kind(lines, "assumed")] == ["", "1 m wide"]


def test_the_horizon_crosses_the_whole_picture_where_level_ground_ends() -> None:
    (horizon,) = of_kind(ground_lines(SIMULATED), "horizon")
    assert (horizon.start[0], horizon.end[0]) == pytest.approx((0.0, 1.0))
    assert horizon.start[1] == horizon.end[1] == pytest.approx(SIMULATED.row(1e9)) == horizon_row(SIMULATED)


def test_a_camera_whose_right_side_is_down_sees_the_horizon_rise_to_the_right() -> None:
    (horizon,) = of_kind(ground_lines(replace(SIMULATED, roll=5.0)), "horizon")
    assert horizon.end[1] < horizon.start[1]


def test_a_horizon_above_the_picture_is_left_out_and_its_row_still_told() -> None:
    steep = GroundCamera.pinhole(1.0, 50.0, 60.0, 4 / 3)
    assert not of_kind(ground_lines(steep), "horizon")
    assert horizon_row(steep) < 0


def test_where_it_stops_is_a_line_and_beyond_six_metres_none() -> None:
    (stop,) = of_kind(ground_lines(SIMULATED, stops=3.3), "stop")
    assert stop.label == "stops in 3.3 m"
    assert stop.start[1] == pytest.approx(SIMULATED.row(3.3))
    assert not of_kind(ground_lines(SIMULATED, stops=6.8), "stop")
    assert not of_kind(ground_lines(SIMULATED), "stop")


def test_a_camera_that_looks_back_sees_no_line_but_the_horizon() -> None:
    behind = replace(SIMULATED, heading=180.0)
    assert [line.kind for line in ground_lines(behind, 0.8, 3.0)] == ["horizon"]


@given(
    lens=st.builds(Lens, *[st.floats(0.3, 2.0)] * 2),
    height=st.floats(0.05, 20),
    tilt=st.floats(-45, 85),
    front=st.floats(0, 20),
    roll=st.floats(-45, 45),
    heading=st.floats(-180, 180),
    width=st.none() | st.floats(0.1, 10),
    stops=st.none() | st.floats(0, 20),
)
def test_whatever_the_mount_no_line_leaves_the_picture_and_each_lies_on_the_ground(
    lens: Lens,
    height: float,
    tilt: float,
    front: float,
    roll: float,
    heading: float,
    width: float | None,
    stops: float | None,
) -> None:
    camera = GroundCamera(lens, height, tilt, front, roll, heading)
    for line in ground_lines(camera, width, stops):
        ends = np.array([line.start, line.end])
        assert (ends >= -1e-6).all()
        assert (ends <= 1 + 1e-6).all()
        if line.kind in ("side", "assumed"):
            half = (1.0 if width is None else width) / 2
            middle = camera.to_ground(ends.mean(axis=0)[None])[0]
            assert abs(middle[1]) == pytest.approx(half, rel=1e-3)
