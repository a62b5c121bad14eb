"""How the rover is held: for how long its script may brake, and what that does to the stopping distance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.config import Config
from companion.config.schema import MountSection, StoppingSection
from companion.config.stopping import Stopping, judge_stopping, longest_brake
from companion.vehicle.ardupilot import LONGEST_BRAKE
from companion.vehicle.brakes import Brakes

FIGURES: dict[str, Any] = {"speed": 1.5, "brake_time_constant": 0.4, "brake_braking": 1.0}
MOUNT = MountSection(height=0.6, tilt=15.0)


def configured(**stopping: Any) -> Config:
    section = StoppingSection(**{"time_constant": 1.76, "braking": 6.46, **stopping})
    return replace(Config(), mount=MOUNT, stopping=section)


def judged(config: Config) -> Stopping:
    found = judge_stopping(config)
    assert isinstance(found, Stopping)
    return found


def test_without_a_word_it_holds_at_once_as_before() -> None:
    config = configured(**FIGURES)
    assert longest_brake(config) == 0.0
    assert "in HOLD)" in judged(config).describe()
    assert judged(config) == judged(configured(speed=1.5))


def test_it_may_brake_1_3_times_as_long_as_the_measured_brake_takes_from_the_fastest_speed() -> None:
    config = configured(hold_by="brake", **FIGURES)
    takes = Brakes.of(1.0, 0.4).seconds(1.12 * 1.5, 0.1)
    assert longest_brake(config) == pytest.approx(1.3 * takes)
    assert 2.0 < longest_brake(config) < LONGEST_BRAKE


def test_and_four_seconds_at_most_or_where_nothing_was_measured() -> None:
    assert longest_brake(configured(hold_by="brake", **{**FIGURES, "speed": 10.0})) == LONGEST_BRAKE
    assert longest_brake(configured(hold_by="brake", speed=1.5)) == LONGEST_BRAKE
    assert longest_brake(configured(hold_by="brake", **{**FIGURES, "speed": None})) == LONGEST_BRAKE
    assert longest_brake(configured(hold_by="brake", **{**FIGURES, "speed": 0.05})) >= 0.0


def test_the_stopping_distance_stays_that_of_hold_since_the_script_may_hold_at_once() -> None:
    assert judged(configured(hold_by="brake", **FIGURES)) == judged(configured(speed=1.5))


def test_it_tells_the_way_of_the_brake_too_and_that_of_hold_from_where_it_ends() -> None:
    config = configured(hold_by="brake", **FIGURES)
    held, brake = judged(config), Brakes.of(1.0, 0.4)
    assert held.braked == pytest.approx(
        brake.way(held.driven) - brake.way(0.1) + held.brakes.way(0.1), abs=1e-3
    )
    assert f"in HOLD, {held.braked:.1f} m where the script brakes first)" in held.describe()
    assert judged(configured(hold_by="brake", speed=1.5)).braked is None
    assert judged(configured(**FIGURES)).braked is None


def test_a_brake_that_must_end_after_four_seconds_ends_in_hold_from_what_speed_is_left() -> None:
    held = judged(configured(hold_by="brake", **{**FIGURES, "speed": 10.0}))
    brake = Brakes.of(1.0, 0.4)
    left = brake.left(held.driven, LONGEST_BRAKE, 0.1)
    assert brake.seconds(held.driven, left) == pytest.approx(LONGEST_BRAKE)
    assert left > 5.0
    assert held.braked is not None
    assert held.braked == pytest.approx(brake.way(held.driven) - brake.way(left) + held.brakes.way(left))


def test_half_a_measurement_is_refused() -> None:
    assert list(StoppingSection(brake_braking=1.0).conflicts())
    assert list(StoppingSection(brake_time_constant=1.0).conflicts())
    assert not list(StoppingSection(**FIGURES).conflicts())


@pytest.mark.parametrize(("speed", "seconds"), [(1.1, 1.0), (0.1, 0.0)])
def test_the_time_that_constant_braking_takes(speed: float, seconds: float) -> None:
    assert Brakes.of(1.0, 0.0).seconds(speed, 0.1) == pytest.approx(seconds)
