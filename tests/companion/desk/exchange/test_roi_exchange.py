"""Regions of interest exchanged between vehicles, on the simulated trail and by its true labels."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.cli import main
from anytraverse.errors import SettingsError, UnknownWordError
from anytraverse.ground import RELIABLE
from anytraverse.perception import Prompt
from companion.desk.exchange.drive import Approach, Placed, RegionTally, drive, make_trail
from companion.desk.exchange.results import Pair
from companion.desk.exchange.truth import TruePerceiver
from companion.desk.exchange.vehicles import SHIPPED, ExchangeVehicle, shipped_vehicles
from companion.sim.field.render import LABELS
from companion.vision.warm_up import judging_settings

Out = pytest.CaptureFixture[str]
QUADRUPED, ROVER, ATV = shipped_vehicles()
VEHICLES = (QUADRUPED, ROVER, ATV)
CONFIG = Path(__file__).parents[4] / "config"


@pytest.fixture(scope="module")
def past_one_thing() -> list[RegionTally]:
    """What the ATV sees of the first thing, with the quadruped's region and with its own."""
    truth = TruePerceiver()
    judging = judging_settings(ATV.config, truth)
    regions = [ATV.looking_at(one.region) for one in (QUADRUPED, ATV)]
    settings = [replace(judging, ground=one, region=one.in_picture(None).region.bounds) for one in regions]
    return drive(ATV, settings, truth, 0, 16.0)


@pytest.mark.slow
def test_with_the_quadrupeds_region_the_call_is_too_late_for_the_atv(
    past_one_thing: list[RegionTally],
) -> None:
    (one,) = past_one_thing[0].approaches
    assert one.call is not None
    assert 1.0 < one.call < ATV.still_needs


@pytest.mark.slow
def test_with_its_own_region_it_stops_in_time(past_one_thing: list[RegionTally]) -> None:
    (one,) = past_one_thing[1].approaches
    assert one.call is not None
    assert one.first is not None
    assert ATV.still_needs < one.call < one.first <= ATV.region.far
    assert one.first > ATV.stopping.needs


def test_a_call_opens_a_vote_after_the_first_frame(past_one_thing: list[RegionTally]) -> None:
    for tally in past_one_thing:
        (one,) = tally.approaches
        assert one.first is not None
        assert one.call is not None
        assert one.first - one.call == pytest.approx(ATV.speed / 10)


def test_the_frame_of_the_call_is_kept_for_the_picture(past_one_thing: list[RegionTally]) -> None:
    for tally in past_one_thing:
        (one,) = tally.approaches
        view = tally.views[one.kind]
        assert view.distance == one.call
        assert view.seen.tile is not None


def test_nothing_beside_the_way_has_called_so_far(past_one_thing: list[RegionTally]) -> None:
    assert all(tally.needless == 0 and tally.free > 5.0 for tally in past_one_thing)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=SHIPPED)
def test_a_vehicle_that_ships_stops_in_what_its_own_region_shows(vehicle: ExchangeVehicle) -> None:
    assert vehicle.stopping.enough
    assert vehicle.region.far == pytest.approx(1.2 * vehicle.stopping.needs + 0.5)
    assert vehicle.region.width == pytest.approx(vehicle.region.vehicle + 0.6)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=SHIPPED)
def test_what_a_call_still_needs_leaves_out_only_the_time_in_which_a_thing_is_noticed(
    vehicle: ExchangeVehicle,
) -> None:
    config = vehicle.config
    noticed = max(config.call.window / config.camera.rate, config.freshness)
    assert vehicle.stopping.needs - vehicle.still_needs == pytest.approx(vehicle.speed * noticed)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=SHIPPED)
@pytest.mark.parametrize("other", VEHICLES, ids=SHIPPED)
def test_anothers_region_lies_where_the_camera_sees_ground(
    vehicle: ExchangeVehicle, other: ExchangeVehicle
) -> None:
    region = vehicle.looking_at(other.region)
    assert region.camera == vehicle.camera
    assert region.far + vehicle.camera.front <= RELIABLE
    assert region.near >= vehicle.camera.nearest(region.width)
    bounds = region.in_picture(None).region.bounds
    assert bounds.bottom - bounds.top > 0.1


def test_a_region_of_which_the_camera_sees_nothing_is_refused() -> None:
    with pytest.raises(SettingsError, match="holds no ground"):
        ATV.looking_at(replace(QUADRUPED.region, near=0.3, far=0.6))


def test_each_trail_has_a_drum_a_rock_and_a_log_on_it_and_drums_beside_it() -> None:
    for seed in range(3):
        _, placed = make_trail(seed)
        assert sorted(one.thing.kind for one in placed if one.on_trail) == ["drum", "log", "rock"]
        beside = [one for one in placed if not one.on_trail]
        assert {one.thing.kind for one in beside} == {"drum"}
        assert all(1.0 <= abs(one.aside) <= 1.4 for one in beside)
        assert not any(one.in_way(QUADRUPED) or one.in_way(ROVER) for one in beside)
        assert sum(one.in_way(ATV) for one in beside) == 2


def test_what_is_put_down_stands_where_it_is_said_to() -> None:
    world, placed = make_trail(1)
    for one in placed:
        s, aside = world.trail.nearest(one.thing.x, one.thing.y)
        assert [s, aside] == pytest.approx([one.s, one.aside], abs=0.05)


def _pair(vehicle: Any, *calls: float | None) -> Pair:
    approaches = [Approach("drum", 0, 0.0, call, call) for call in calls]
    return Pair(vehicle, "atv", 0.3, 4.0, RegionTally(approaches, free=50.0, needless=2))


def test_too_late_is_nearer_than_what_is_still_needed_and_never_is_too_late() -> None:
    pair = _pair(SimpleNamespace(name="rover", still_needs=2.0), 1.9, 2.0, None)
    assert (pair.late, pair.never) == (2, 1)
    assert pair.needless == pytest.approx(4.0)


def test_the_truth_knows_a_border_of_two_grounds_and_not_a_drum() -> None:
    labels = np.full((48, 64), LABELS.index("grass"), np.uint8)
    labels[::2] = LABELS.index("dirt path")
    labels[10:20, 20:30] = LABELS.index("drum")
    labels[30:, 40:] = LABELS.index("bush")
    large = np.repeat(np.repeat(labels, 5, axis=0), 5, axis=1)[
        2:-3
    ]  # so that a cell shows two rows of grounds
    truth = TruePerceiver()
    truth.show(large)
    features = truth.encode(np.zeros((*large.shape, 3), np.uint8))
    maps = truth.attend(features, [Prompt(word) for word in ("grass", "dirt path", "bush")])
    found = maps.max(axis=0)
    assert found[40, 10] == pytest.approx(1.0, abs=1e-5)
    assert found[15, 25] == pytest.approx(0.0, abs=1e-5)
    assert maps[2, 40, 50] == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(UnknownWordError):
        truth.meaning("drum")


@pytest.mark.slow
def test_the_command_prints_a_table_and_writes_it_with_a_plot_and_four_views(
    tmp_path: Path, capsys: Out
) -> None:
    given = [f"--vehicle={CONFIG / 'vehicles' / name}.toml" for name in ("quadruped", "atv")]
    out = tmp_path / "new"
    assert main(["roi-exchange", *given, "--seeds", "0", "--metres", "2", "--out", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    told = json.loads(printed[-1])
    assert [(one["vehicle"], one["region"]) for one in told["pairs"]] == [
        ("quadruped", "quadruped"),
        ("quadruped", "atv"),
        ("atv", "quadruped"),
        ("atv", "atv"),
    ]
    assert [one["name"] for one in told["vehicles"]] == ["quadruped", "atv"]
    assert any(line.startswith("atv           quadruped") for line in printed)
    assert json.loads((out / "table.json").read_text()) == told
    plot, views = cv2.imread(str(out / "plot.png")), cv2.imread(str(out / "views.jpg"))
    assert plot is not None
    assert views is not None
    assert views.shape[1] == 960
    assert (out / "views.jpg").stat().st_size < 200_000


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[mount]\nheight = 1\ntilt = 10\n[stopping]\nspeed = 1\n", "set [mount] width"),
        ("[mount]\nwidth = 1\n", "[mount] height and tilt, and [stopping] speed"),
        ("[mount]\nwidth = 100\n", "mount.width = 100"),
    ],
)
def test_a_vehicle_that_lacks_a_figure_is_refused_in_a_line(
    tmp_path: Path, capsys: Out, text: str, why: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    assert main(["roi-exchange", "--vehicle", str(tmp_path / "mine.toml")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("anytraverse roi-exchange: ")
    assert why in told
    assert told.count("\n") == 2, "that it starts, and why not"


def test_a_vehicle_that_is_not_there_is_told_by_its_own_name(tmp_path: Path, capsys: Out) -> None:
    absent = tmp_path / "mine.toml"
    assert main(["roi-exchange", "--vehicle", str(absent)]) == 2
    assert f"roi-exchange: {absent}: there is no such file: give" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--metres", "0"], ["--metres", "nan"], ["--seeds", "-1"]])
def test_a_trail_that_is_none_is_refused(capsys: Out, arguments: list[str]) -> None:
    assert main(["roi-exchange", *arguments]) == 2
    assert "give --metres of 1 or more" in capsys.readouterr().err


def test_one_vehicle_has_nobody_to_exchange_with(capsys: Out) -> None:
    assert main(["roi-exchange", "--vehicle", str(CONFIG / "vehicles" / "atv.toml")]) == 2
    assert "two vehicles or more" in capsys.readouterr().err


def test_a_thing_belongs_to_the_way_of_a_vehicle_that_is_wide_enough() -> None:
    _, placed = make_trail(0)
    thing = placed[0].thing
    thing.radius, thing.length = 0.29, 0.0
    assert [Placed(thing, 0.0, 1.1).in_way(one) for one in VEHICLES] == [False, False, True]
    assert math.isclose(ATV.region.vehicle, 1.2)
