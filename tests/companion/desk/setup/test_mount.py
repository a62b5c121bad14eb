"""Lines that somebody drags in the picture, and the height and tilt that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.desk.setup.mount import ASSUMED, dragged, ground
from companion.pages.requests import RequestError

DEFAULT = Config()


def looking(
    height: float, tilt: float, front: float = 0.0, roll: float = 0.0, heading: float = 0.0
) -> Config:
    mount = MountSection(height=height, tilt=tilt, front=front, roll=roll, heading=heading)
    return replace(DEFAULT, mount=mount)


def row_of(config: Config, metres: float) -> float:
    """Where the picture's middle column meets the ground so far ahead of the front."""
    camera = config.ground_camera
    assert camera is not None
    rows = np.linspace(-0.5, 6.0, 130001)
    ahead = camera.to_ground(np.column_stack([np.full(len(rows), 0.5), rows]))[:, 0] - camera.front
    seen = np.flatnonzero(ahead <= metres)
    return float(rows[seen[0]])


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    height=st.floats(0.2, 3.0),
    tilt=st.floats(0.0, 30.0),
    front=st.floats(0.0, 1.0),
    roll=st.floats(-10.0, 10.0),
    heading=st.floats(-20.0, 20.0),
    metres=st.integers(1, 5),
)
def test_a_line_that_lies_where_the_ground_is_gives_the_mount_that_put_it_there(
    height: float, tilt: float, front: float, roll: float, heading: float, metres: int
) -> None:
    true = looking(height, tilt, front, roll, heading)
    horizon = row_of(true, 1e4)
    start = looking(1.0, 10.0, front, roll, heading)
    _, found_tilt = dragged(start, "horizon", horizon)
    assert found_tilt == pytest.approx(tilt, abs=0.05)
    tilted = looking(1.0, tilt, front, roll, heading)
    found_height, _ = dragged(tilted, str(metres), row_of(true, metres))
    assert found_height == pytest.approx(height, rel=0.02)


def test_where_nothing_is_configured_the_lines_begin_at_an_assumed_mount() -> None:
    height, _ = dragged(DEFAULT, "horizon", 0.3)
    assert height == ASSUMED[0]
    shown = ground(DEFAULT)
    assert not shown["known"]
    assert [line["label"] for line in shown["lines"]][:2] == ["horizon", "2 m"]
    assert "[mount] height and tilt" in shown["stops"]


def test_a_metre_above_the_horizon_is_refused_with_what_to_do() -> None:
    with pytest.raises(RequestError, match="drag the horizon first"):
        dragged(looking(1.0, 10.0), "2", 0.05)


@pytest.mark.parametrize("line", ["", "two", "nan", "-9"])
def test_what_is_no_line_is_refused(line: str) -> None:
    with pytest.raises(RequestError):
        dragged(looking(1.0, 10.0), line, 0.9)


def test_with_speed_and_width_the_stop_and_the_region_in_metres_are_told() -> None:
    config = replace(
        looking(1.0, 7.0, front=0.6),
        camera=replace(DEFAULT.camera, view=75.0),
        stopping=StoppingSection(speed=0.8),
    )
    config = replace(config, mount=replace(config.mount, width=0.9))
    shown = ground(config)
    assert shown["enough"]
    assert shown["stops"].startswith("at 0.8 m/s it takes")
    assert [line["kind"] for line in shown["lines"]].count("stop") == 1
    (left, top), (right, _), (_, bottom), _ = shown["region"]
    assert left < right
    assert top < bottom
    assert "at 2 m/s" in ground(config, speed=2.0)["stops"], "the autopilot's own speed counts"
