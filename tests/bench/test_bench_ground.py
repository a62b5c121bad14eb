"""The errors of distances that `make bench-ground` measures."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench import ground
from bench.ground import GOALS, Ride, cost, errors_of


def ninety(ride: Ride, seed: int = 0) -> dict[str, dict[float, float]]:
    found = errors_of(ride, seed, 40.0)
    return {
        name: {distance: float(np.percentile(errors, 90)) for distance, errors in one.items()}
        for name, one in found.items()
    }


def test_of_a_rover_that_stays_level_only_the_maps_rows_are_an_error() -> None:
    found = ninety(Ride("level"))
    assert found["none"] == found["reported"] == found["true"]
    assert 0.05 < found["none"][4.0] < 0.25


def test_reports_make_a_swing_a_third_of_what_it_was_and_meet_the_goals() -> None:
    found = ninety(Ride("swing", swing=2.0))
    for distance, goal in GOALS.items():
        assert found["reported"][float(distance)] < min(goal, found["none"][float(distance)] / 3)
        assert found["true"][float(distance)] <= found["reported"][float(distance)]


def test_a_calibrated_distortion_is_no_error() -> None:
    bent, straight = ninety(Ride("bent", distortion=-0.1)), ninety(Ride("level"))
    assert bent["none"][5.0] == pytest.approx(straight["none"][5.0], abs=0.1)


def test_a_region_in_metres_costs_some_milliseconds_at_most() -> None:
    assert set(cost(5)) == {"ms_fractions_50", "ms_fractions_95", "ms_metres_50", "ms_metres_95"}


def test_the_last_line_is_one_json_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["bench.ground", "--quick"])
    monkeypatch.setattr(ground, "RIDES", [Ride("swing 2", swing=2.0)])
    ground.main()
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["goals_met"] is True
    assert (
        told["rides"]["swing 2"]["reported"] == told["range_error_90"] | told["rides"]["swing 2"]["reported"]
    )
