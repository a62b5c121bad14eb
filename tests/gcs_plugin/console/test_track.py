"""The way of a rover as the console keeps it, and the picture that it is drawn on."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_plugin.client.vehicle import Position, read_position
from gcs_plugin.console.track import LARGEST_BACKGROUND, MOST_POINTS, Track, read_background

PNG = b"\x89PNG\r\n\x1a\n"
DEGREES_A_METRE = 1 / 111_320.0


@given(st.integers(0, 3000), st.floats(0.2, 3.0))
def test_a_way_of_any_length_is_kept_within_bounds_from_its_beginning_to_its_end(
    steps: int, metres: float
) -> None:
    track = Track()
    for step in range(steps):
        track.follow(Position(47.0 + step * metres * DEGREES_A_METRE, 179.9999999, None))
    assert len(track.points) <= MOST_POINTS
    if steps:
        assert track.points[0] == (47.0, 179.9999999)
        ahead = (47.0 + (steps - 1) * metres * DEGREES_A_METRE - track.points[-1][0]) / DEGREES_A_METRE
        assert ahead <= max(2.0, 4 * steps * metres / MOST_POINTS), "the last point is not far behind"


def test_a_rover_that_stands_makes_one_point_also_beside_longitude_180() -> None:
    track = Track()
    assert [track.follow(Position(10.0, east, 90.0)) for east in (179.9999999, -179.9999999, 179.9)] == [
        True,
        False,
        True,
    ]
    assert track.revision == len(track.points) == 2


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1), st.integers(0, 65535))
def test_a_position_of_any_message_is_one_on_earth_or_none(
    latitude: int, longitude: int, heading: int
) -> None:
    found = read_position(latitude, longitude, heading)
    if found is not None:
        assert abs(found.latitude) <= 90
        assert abs(found.longitude) <= 180
        assert found.heading is None or 0 <= found.heading < 360
    assert read_position(0, 0, heading) is None


def test_a_background_is_a_picture_with_its_corners(tmp_path: Path) -> None:
    picture = tmp_path / "field@home.png"
    picture.write_bytes(PNG)
    found = read_background(f"{picture}@47.1,8.0,47.0,8.2")
    assert (found.kind, found.corners) == ("image/png", (47.1, 8.0, 47.0, 8.2))
    for corners in (
        "47.0,8.0,47.1,8.2",
        "47.1,8.2,47.0,8.0",
        "nan,8.0,47.0,8.2",
        "91,8,47,9",
        "1,2,3",
        "inf,1,2,3",
    ):
        with pytest.raises(ValueError, match="corner"):
            read_background(f"{picture}@{corners}")
    for content in (b"GIF89a", b"", PNG + bytes(LARGEST_BACKGROUND)):
        picture.write_bytes(content)
        with pytest.raises(ValueError, match="no PNG or JPEG"):
            read_background(f"{picture}@47.1,8.0,47.0,8.2")


@given(st.text(max_size=40))
def test_any_text_is_a_background_or_refused(text: str) -> None:
    with pytest.raises(ValueError, match="--background"):
        read_background(text)
