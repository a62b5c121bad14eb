from __future__ import annotations

import math

import numpy as np
import pytest

from companion.sim.field.things import KINDS, World

SEEDS = range(1, 21)
ROVER = 0.6  # m, its radius


def _touched(world: World) -> list[str]:
    trail = world.trail
    touched: list[str] = []
    for s in np.arange(trail.start, trail.start + trail.length, 0.25):
        at = trail.pose(s)
        touched += [thing for thing in world.contact(at.x, at.y, ROVER) if thing not in touched]
    return touched


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_rover_on_the_centre_line_meets_the_surprises_and_nothing_else(seed: int) -> None:
    assert _touched(World(seed)) == ["drum-1", "rock-1", "log-1"]
    assert _touched(World(seed, surprises=())) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_surprises_stand_where_they_surprise(seed: int) -> None:
    world = World(seed)
    trail = world.trail
    s, lateral = {}, {}
    for name in ("drum", "rock", "log"):
        thing = world.things[f"{name}-1"]
        assert thing.surprise
        s[name], lateral[name] = trail.nearest(thing.x, thing.y)
    assert 18 <= s["drum"] - trail.start <= 25
    assert abs(lateral["drum"]) <= 0.31
    assert s["rock"] - trail.borders["forest"][0] >= 15
    assert trail.zone(s["rock"]) == "forest"
    assert abs(lateral["rock"]) <= 0.41
    assert 0.35 <= world.things["rock-1"].radius <= 0.5
    assert s["log"] - trail.borders["gravel"][0] >= 15
    assert trail.zone(s["log"]) == "gravel"
    across = world.things["log-1"].heading - trail.pose(s["log"]).heading
    assert abs(math.sin(across)) > 0.95


@pytest.mark.parametrize("seed", SEEDS)
def test_scenery_keeps_off_the_path(seed: int) -> None:
    world = World(seed)
    for thing in world.things.values():
        if thing.surprise:
            continue
        _, lateral = world.trail.nearest(thing.x, thing.y)
        assert abs(lateral) - thing.radius >= (1.9 if thing.kind == "puddle" else 2.4), thing.id


def test_a_forest_is_full_of_trees_and_a_meadow_is_not() -> None:
    world = World(3)
    trees = [
        world.trail.zone(world.trail.nearest(thing.x, thing.y)[0])
        for thing in world.things.values()
        if thing.kind == "tree"
    ]
    assert trees.count("forest") > 60
    assert trees.count("meadow") < 10


def test_the_same_seed_gives_the_same_world_and_surprises_vary_with_it() -> None:
    assert World(4).things == World(4).things
    drums = [World(seed).things["drum-1"] for seed in SEEDS]
    assert {drum.look % 3 for drum in drums} == {0, 1, 2}
    assert len({(drum.x, drum.y) for drum in drums}) == len(drums)


def test_surprises_can_be_chosen_and_are_dealt_out_to_the_zones_in_turn() -> None:
    world = World(2, surprises=("rock", "drum", "drum", "log"))
    zones = {
        thing.id: world.trail.zone(world.trail.nearest(thing.x, thing.y)[0])
        for thing in world.things.values()
        if thing.surprise
    }
    assert zones == {"rock-1": "meadow", "log-1": "meadow", "drum-1": "forest", "drum-2": "gravel"}


def test_a_surprise_of_unknown_kind_is_refused_with_the_known_kinds() -> None:
    with pytest.raises(ValueError, match=r"no such surprise: crate; known are bush, tree"):
        World(1, surprises=("crate",))


def test_more_surprises_than_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit into the meadow"):
        World(1, surprises=("drum",) * 12)


def test_a_removed_thing_is_touched_no_more() -> None:
    world = World(1)
    drum = world.things["drum-1"]
    assert world.contact(drum.x, drum.y, 0.1) == ["drum-1"]
    world.remove("drum-1")
    assert world.contact(drum.x, drum.y, 0.1) == []


def test_a_moved_thing_is_touched_where_it_went() -> None:
    world = World(1)
    world.move("rock-1", 200.0, 300.0)
    assert world.contact(200.0, 300.9, ROVER) == ["rock-1"]
    assert world.contact(200.0, 301.2, ROVER) == []


def test_a_log_is_touched_along_all_its_length_and_not_beyond() -> None:
    world = World(1)
    world.move("log-1", 200.0, 0.0)
    log = world.things["log-1"]
    c, s = math.cos(log.heading), math.sin(log.heading)
    inside, outside = log.length / 2 - 0.05, log.length / 2 + 0.05
    assert world.contact(200 + c * inside, s * inside, 0.01) == ["log-1"]
    assert world.contact(200 + c * outside, s * outside, 0.01) == []
    assert world.contact(200 - s * (log.radius + 0.05), c * (log.radius + 0.05), 0.01) == []


@pytest.mark.parametrize("change", ["remove", "move"])
def test_an_unknown_id_is_refused_with_the_known_ones(change: str) -> None:
    world = World(1)
    with pytest.raises(KeyError, match=r"no thing 'drum-9' here; there are: .*drum-1.*rock-1"):
        world.remove("drum-9") if change == "remove" else world.move("drum-9", 0, 0)


def test_a_thing_cannot_be_moved_to_nowhere() -> None:
    with pytest.raises(ValueError, match="finite"):
        World(1).move("drum-1", math.nan, 0)


def test_things_are_of_the_known_kinds() -> None:
    assert {thing.kind for thing in World(1).things.values()} == set(KINDS)


def test_a_longer_trail_has_its_surprises_all_along() -> None:
    world = World(4, ["drum", "rock", "log"] * 2, length=600.0)
    trail = world.trail
    places = sorted(trail.nearest(one.x, one.y)[0] for one in world.things.values() if one.surprise)
    assert [trail.zone(s) for s in places] == ["meadow"] * 2 + ["forest"] * 2 + ["gravel"] * 2
    assert min(np.diff(places)) > 40


def test_a_thing_that_is_put_down_is_there_once() -> None:
    world = World(1, surprises=())
    thing = World(1).things["drum-1"]
    before = world.revision
    world.add(thing)
    assert world.contact(thing.x, thing.y, 0.1) == ["drum-1"]
    assert world.revision > before
    with pytest.raises(ValueError, match="is there already"):
        world.add(thing)
