"""The way from HOLD to standstill: what is fitted never promises less than what was measured."""

from __future__ import annotations

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.config.schema import StoppingSection
from companion.vehicle.brakes import ARDUPILOT, CAUTIOUS, MOST, SPREAD, BrakeFit, Brakes, Measured, fit

TOLERANCE = 0.11
"""The most that the fit to ArduPilot's stops promises above one of them, its share."""


def brakes(found: BrakeFit) -> Brakes:
    return Brakes.of(found.braking, found.time_constant)


def test_the_fit_to_ardupilot_s_stops_is_never_below_one_of_them_and_a_tenth_above_at_most() -> None:
    found = fit(ARDUPILOT)
    for speed, way in ARDUPILOT:
        assert way <= brakes(found).way(speed) <= (1.0 + TOLERANCE) * way
    assert found.excess <= TOLERANCE


@pytest.mark.parametrize("stop", ARDUPILOT)
def test_a_single_braking_figure_measured_at_any_speed_promises_no_stop_shorter_than_it_was(
    stop: Measured,
) -> None:
    lone = Brakes.of(stop.speed**2 / (2.0 * stop.way), None)
    for speed, way in ARDUPILOT:
        assert lone.way(speed) >= way


def test_the_default_promises_no_stop_shorter_than_it_was() -> None:
    lone = Brakes.of(StoppingSection().braking, StoppingSection().time_constant)
    assert all(lone.way(speed) >= way for speed, way in ARDUPILOT)
    assert all(Brakes.of(MOST, None).way(speed) >= way for speed, way in ARDUPILOT)


def test_a_single_figure_counts_where_it_is_worse_than_two_seconds_times_speed() -> None:
    assert Brakes.of(0.5, None).way(1.0) == CAUTIOUS
    assert Brakes.of(0.5, None).way(4.0) == 16.0


def test_a_constant_deceleration_and_a_constant_time_are_found_as_they_are() -> None:
    braked = fit([Measured(v, v * v / 2.4) for v in (0.5, 1.0, 2.0)])
    assert braked.time_constant == 0.0
    assert braked.braking == pytest.approx(1.2, abs=0.011)
    timed = fit([Measured(v, 2.0 * v) for v in (0.5, 1.0, 2.0)])
    assert timed.time_constant == pytest.approx(2.0, abs=0.02)
    assert timed.braking == MOST


@pytest.mark.parametrize(
    "stops", [[], [(1.0, 2.0)], [(1.0, 2.0)] * 5, [(1.0, 2.0), (1.4, 3.0)], [(0.0, 1.0)]]
)
def test_stops_that_are_too_few_or_too_much_alike_are_not_fitted(stops: list[tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match=f"at walking pace and at the fastest.*{SPREAD:g} times"):
        fit(Measured(*stop) for stop in stops)


STOPS = st.lists(
    st.builds(Measured, st.floats(0.1, 10).map(lambda v: round(v, 2)), st.floats(0.05, 60)),
    min_size=2,
    max_size=12,
)


@given(STOPS)
def test_whatever_was_measured_the_fit_is_never_below_it_and_fits_into_a_configuration(
    stops: list[Measured],
) -> None:
    speeds = [stop.speed for stop in stops]
    assume(max(speeds) >= SPREAD * min(speeds))
    found = fit(stops)
    assert all(brakes(found).way(speed) >= way * (1.0 - 1e-6) for speed, way in stops)
    assert found.time_constant >= 0.0
    assert 0.01 <= found.braking <= MOST


@given(st.floats(0.05, 100), st.none() | st.floats(0, 20), st.floats(0, 3), st.floats(0.01, 30))
def test_the_fastest_that_stops_in_some_metres_takes_just_these(
    braking: float, time_constant: float | None, react: float, metres: float
) -> None:
    made = Brakes.of(braking, time_constant)
    speed = made.fastest(metres, react)
    assert speed * react + made.way(speed) == pytest.approx(metres)
