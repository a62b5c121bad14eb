"""A place as JSON values, and the clock that stamps it."""

from __future__ import annotations

import json
import math

from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.history import Place
from companion.vehicle.state import WallClock, read_place
from companion.wire.json_values import place_document

_ANGLE = st.none() | st.integers(-9000, 9000).map(lambda hundredths: hundredths / 100)


@settings(max_examples=60)
@given(
    _ANGLE,
    _ANGLE,
    _ANGLE,
    st.none() | st.integers(1, 4_000_000_000).map(float),
    st.none() | st.just((1.5, -2.25, 90.0)),
)
def test_a_place_comes_back_from_json(
    latitude: float | None,
    longitude: float | None,
    heading: float | None,
    time: float | None,
    attitude: tuple[float, float, float] | None,
) -> None:
    place = Place(latitude, longitude, heading, time, attitude)
    assert read_place(json.loads(json.dumps(place_document(place)))) == place


def test_nonsense_is_no_place() -> None:
    nonsense: list[object] = [
        None,
        [],
        "north",
        {"latitude": "47"},
        {"latitude": math.nan},
        {"roll": 1.0},
        {"time": True},
    ]
    for saved in nonsense:
        assert read_place(saved) == Place()


def test_a_clock_that_was_never_set_gives_way_to_the_autopilots() -> None:
    assert WallClock(lambda: 2e9, lambda: 1.8e9).known() == 1.8e9
    assert WallClock(lambda: 2e9, lambda: 1000.0).known() == 2e9
    nobody = WallClock(lambda: None, lambda: 1000.0)
    assert nobody.known() is None
    assert nobody.stamp() == 1000.0
