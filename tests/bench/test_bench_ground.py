"""What `make bench-ground` measures: errors of distances, and the grid against a frame alone."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from bench.ground import __main__ as bench_ground
from bench.ground import rides
from bench.ground.drives import FieldDrive, Odometry, SeenFrame, gaps
from bench.ground.grid import WAYS, truth
from bench.ground.rides import GOALS, Ride, cost, errors_of
from bench.ground.stops import STOP_GOAL, STOPS
from companion.sim.field.things import FieldThing, World
from companion.sim.field.trail import TrailPose


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
    monkeypatch.setattr(rides, "RIDES", [Ride("swing 2", swing=2.0)])
    bench_ground.main()
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["goals_met"] is True
    assert told["stop_ratio"] <= STOP_GOAL
    assert set(told["stop_ratios"]) == {f"{speed:g}" for speed, _, _ in STOPS}
    assert (
        told["rides"]["swing 2"]["reported"] == told["range_error_90"] | told["rides"]["swing 2"]["reported"]
    )
    assert told["grid_goals_met"] is True
    assert told["false_blocks"] == told["grid"]["truth, swing 2, odometry errs"]["grid"]["false_blocks"]
    assert told["obstacle_recall"] >= told["obstacle_recall_single"] - 0.02
    found = told["grid"]["truth, swing 2"]
    assert found["hidden_things"] == found["held_to_the_end"] == found["drums"] == 1
    assert found["hidden_frames"] == found["held_frames"] > 3
    assert found["drums_found"] == dict.fromkeys(WAYS, 1)
    assert {"ms_p50", "ms_p95"} < told.keys()


def standing_at(x: float, y: float, *, heading: float = 0.0, length: float = 0.0) -> FieldThing:
    thing = FieldThing("one", "log", x, y, 0.2, 0.4, surprise=True)
    thing.heading, thing.length = heading, length
    return thing


def test_gaps_are_those_to_the_rim_as_contact_counts_them() -> None:
    world, pose = World(0, ()), TrailPose(3.0, 4.0, 1.0)
    thing = standing_at(4.0, 5.0, heading=0.7, length=2.0)
    world.things = {thing.id: thing}
    for ahead, left in ((1.0, 0.0), (2.0, 1.0), (0.0, -1.0), (1.3, 0.3)):
        x = pose.x + ahead * math.cos(1.0) - left * math.sin(1.0)
        y = pose.y + ahead * math.sin(1.0) + left * math.cos(1.0)
        gap = float(gaps(thing, pose, np.array([[ahead, left]]))[0])
        assert world.contact(x, y, gap + 1e-6) == ["one"]
        assert gap < 0 or not world.contact(x, y, gap - 1e-6)


def test_odometry_that_errs_counts_too_much_way_and_turns() -> None:
    odometry = Odometry(0.02, 0.2)
    told = [odometry.at(SeenFrame(at, TrailPose(at, 0.0, 0.0), None, {})) for at in np.arange(0.0, 10.1, 0.5)]
    assert told[0] == (0.0, 0.0, 0.0)
    assert told[-1].heading == pytest.approx(2.0)
    assert np.hypot(*told[-1][:2]) == pytest.approx(10.2, abs=0.01)


def test_cells_at_borders_and_before_a_things_middle_do_not_count() -> None:
    world = World(0, ())
    thing = standing_at(3.0, 0.0)
    world.things = {thing.id: thing}
    ground = np.array([[2.0, 0.0], [2.75, 0.0], [2.9, 0.0], [3.0, 0.0], [3.1, 0.15], [3.25, 0.0], [3.4, 0.0]])
    free, obstacle = truth(
        FieldDrive(world, (), iter(())), SeenFrame(0.0, TrailPose(0.0, 0.0, 0.0), None, {}), ground
    )
    assert free.tolist() == [True, False, False, False, False, False, True]
    assert obstacle.tolist() == [False, False, False, True, True, False, False]
