"""What `make bench-field` drives and counts: random trails, things with room and without, who answers."""

from __future__ import annotations

import json
from itertools import pairwise
from random import Random

import numpy as np
import pytest

from anytraverse.operations import SetWord
from bench.field_drive import __main__ as bench_field
from bench.field_drive.autopilot import SLOWEST, ScriptedAutopilot
from bench.field_drive.drive import drive_all, stopping
from bench.field_drive.operator_model import forbids
from bench.field_drive.scoring import DriveResult, Score, figures
from bench.field_drive.trails import (
    LONG,
    MARGIN,
    SHORT,
    VEHICLE,
    VERGE,
    FieldRoute,
    make_route,
    room_beside,
)
from companion.calls.decisions import SetMode
from companion.calls.mode_monitor import ModeAnswer
from companion.guide.rules import GuideAnswer
from companion.sim.field.rover import STEP, MotorDrive, Rover
from companion.sim.field.trail import Trail
from companion.vehicle import ardupilot

SEEDS = range(1, 9)
STOPS = 4.0
NEEDS = VEHICLE + 2 * MARGIN


@pytest.fixture(scope="module")
def routes() -> list[FieldRoute]:
    return [make_route(seed, lambda _: STOPS) for seed in SEEDS]


def lateral(route: FieldRoute, x: float, y: float) -> float:
    return route.world.trail.nearest(x, y)[1]


def test_the_same_seed_gives_the_same_trail(routes: list[FieldRoute]) -> None:
    for route in routes:
        again = make_route(route.seed, lambda _: STOPS)
        assert (again.begin, again.metres, again.swing, again.latency) == (
            route.begin,
            route.metres,
            route.swing,
            route.latency,
        )
        assert again.world.things == route.world.things
        assert [one.things for one in again.placed] == [one.things for one in route.placed]
        assert np.array_equal(again.world.trail.points, route.world.trail.points)


def test_routes_are_60_to_80_m_of_a_path_3_to_4_8_m_wide_in_one_kind_of_surroundings(
    routes: list[FieldRoute],
) -> None:
    halves = set()
    for route in routes:
        trail, s = route.world.trail, route.begin + np.arange(0.0, route.metres, 0.1)
        assert SHORT <= route.metres <= LONG
        assert 1.5 <= trail.half_width(s).min() <= trail.half_width(s).max() <= 2.4
        assert len({trail.zone(one) for one in s}) == 1
        halves.add(round(trail.course.half, 1))
    assert len(halves) > 3


def test_what_has_room_leaves_it_beside_it_on_the_path_and_stands_in_the_way(
    routes: list[FieldRoute],
) -> None:
    for route in routes:
        for one in route.placed:
            (thing, *others), trail = one.things, route.world.trail
            aside = lateral(route, thing.x, thing.y)
            if one.room:
                assert not others
                assert room_beside(trail, one.s, aside, thing.radius) > NEEDS
                assert abs(aside) - thing.radius < VEHICLE / 2


def test_what_has_no_room_closes_the_path_and_its_verges_without_a_gap(routes: list[FieldRoute]) -> None:
    rows = [(route, one) for route in routes for one in route.placed if not one.room]
    assert rows
    for route, one in rows:
        sides = sorted(lateral(route, thing.x, thing.y) for thing in one.things)
        length, half = one.things[0].length, float(route.world.trail.half_width(np.array(one.s)))
        assert max(after - before - length for before, after in pairwise(sides)) < 0.2
        assert sides[-1] + length / 2 > half + VERGE - 0.1
        assert sides[0] - length / 2 < -half - VERGE + 0.1


def test_late_is_what_appears_nearer_than_the_rover_stops(routes: list[FieldRoute]) -> None:
    appearing = [one for route in routes for one in route.placed if one.appears is not None]
    assert {one.late for one in appearing} == {True, False}
    assert all(one.late == (one.appears < STOPS) for one in appearing if one.appears is not None)
    for route in routes:
        shown = {thing.id for one in route.placed if one.appears is None for thing in one.things}
        assert shown <= set(route.world.things)
        hidden = {thing.id for one in route.placed if one.appears is not None for thing in one.things}
        assert not hidden & set(route.world.things)


def test_the_stopping_way_grows_with_the_latency() -> None:
    assert 3.0 < stopping(0.0) < stopping(0.3) < 5.0


def test_a_thing_counts_as_passed_where_it_was_neither_touched_nor_asked_about(
    routes: list[FieldRoute],
) -> None:
    route = next(
        one for one in routes if sum(it.room and not it.drivable and not it.late for it in one.placed) >= 3
    )
    rooms = [one for one in route.placed if one.room and not one.drivable and not one.late]
    there = dict(route.world.things)
    for one in rooms:
        route.world.things[one.things[0].id] = one.things[0]
    score = Score("guide", route)
    first, second, *others = (one.s - route.begin for one in rooms)
    score.touched([rooms[0].things[0].id])
    score.id_is(7, second - 3.0)
    score.moved(route.metres, -0.2)
    found = score.ended(stood=False, seconds=60.0)
    route.world.things = there
    assert first < second
    assert (found.rooms, found.passed, found.asked) == (len(rooms), len(others), 1)
    assert found.contacts == [rooms[0].things[0].id]
    assert found.edge == -0.2


def test_a_hold_with_nothing_in_the_way_is_needless_and_a_renamed_one_was_asked_once(
    routes: list[FieldRoute],
) -> None:
    score = Score("hold", routes[0])
    score.held(-20.0)
    score.id_is(1, -20.0)
    score.renamed(1)
    score.id_is(2, -20.0)
    found = score.ended(stood=True, seconds=1.0)
    assert (found.needless, found.asked, found.passed) == (1, 1, 0)


def test_touching_what_was_late_or_is_drivable_is_counted_apart(routes: list[FieldRoute]) -> None:
    for route in routes:
        score = Score("hold", route)
        score.touched([thing.id for one in route.placed for thing in one.things])
        found = score.result
        late = {thing.id for one in route.placed if one.late for thing in one.things}
        free = {thing.id for one in route.placed if one.drivable for thing in one.things}
        assert set(found.late_contacts) == late
        assert not (late | free) & set(found.contacts)


def test_figures_of_several_drives_are_shares_of_all_their_metres() -> None:
    drives = [
        DriveResult("hold", 1, 60.0, driven=30.0, rooms=3, passed=1, needless=1, edge=0.4, stood=True),
        DriveResult("hold", 2, 70.0, driven=70.0, rooms=1, passed=1, edge=-0.1),
    ]
    told = figures(drives)
    assert told is not None
    assert told["route_share"] == pytest.approx(100 / 130, abs=0.001)
    assert (told["passed_share"], told["stood"], told["edge_min_m"]) == (0.5, 1, -0.1)
    assert told["needless_stops_per_100m"] == 1.0
    assert figures([]) is None


def test_a_mode_is_set_late_and_only_out_of_the_mode_that_was_meant() -> None:
    rover = Rover(Trail(1))
    autopilot = ScriptedAutopilot(rover, Random(1), 0.0)
    autopilot.request(SetMode(ardupilot.HOLD, ardupilot.AUTO, 1))
    assert not list(autopilot.step())
    rover.step(SLOWEST + STEP)
    assert list(autopilot.step()) == [ModeAnswer(ardupilot.HOLD, accepted=True)]
    autopilot.by_hand(ardupilot.AUTO)
    autopilot.request(SetMode(ardupilot.GUIDED, ardupilot.HOLD, 1))
    rover.step(SLOWEST + STEP)
    assert list(autopilot.step()) == [ModeAnswer(ardupilot.GUIDED, accepted=False, by_hand=True)]
    assert (autopilot.mode, autopilot.overrides) == (ardupilot.AUTO, 0)


def test_only_words_that_all_forbid_forbid() -> None:
    assert forbids([SetWord("drum", -1.0)])
    assert not forbids([SetWord("drum", -1.0), SetWord("grass", 1.0)])
    assert not forbids([])


def test_a_request_to_guide_is_granted_out_of_auto_and_ends_out_of_our_own_guided_alone() -> None:
    rover = Rover(Trail(1))
    autopilot = ScriptedAutopilot(rover, Random(1), 2.0)
    there, back = SetMode(ardupilot.GUIDED, ardupilot.AUTO), SetMode(ardupilot.AUTO, ardupilot.GUIDED)
    autopilot.request(there, guide=True)
    rover.step(SLOWEST + STEP)
    assert list(autopilot.step()) == [GuideAnswer(ardupilot.GUIDED, done=True)]
    autopilot.target((0.5, 10.0))
    assert rover.drive is MotorDrive.TARGET
    autopilot.request(back, guide=True)
    rover.step(SLOWEST + STEP)
    assert list(autopilot.step()) == [GuideAnswer(ardupilot.AUTO, done=True)]
    autopilot.by_hand(ardupilot.GUIDED)
    autopilot.request(back, guide=True)
    rover.step(SLOWEST + STEP)
    assert list(autopilot.step()) == [GuideAnswer(ardupilot.AUTO, done=None)]
    assert (autopilot.mode, autopilot.takeovers, autopilot.overrides) == (ardupilot.GUIDED, 1, 0)


def test_a_hold_out_of_our_guided_leaves_it_brakes_and_then_holds() -> None:
    rover = Rover(Trail(1), cruise_speed=1.0)
    autopilot = ScriptedAutopilot(rover, Random(1), 2.0)
    autopilot.request(SetMode(ardupilot.GUIDED, ardupilot.AUTO), guide=True)
    rover.step(2.0)
    list(autopilot.step())
    autopilot.target((1.0, 0.0))
    autopilot.request(SetMode(ardupilot.HOLD, ardupilot.GUIDED, 3))
    rover.step(SLOWEST + STEP)
    assert [one.mode for one in autopilot.step()] == [ardupilot.HOLD]
    shown = [autopilot.report(0.0).mode for _ in range(3)]
    assert shown == [ardupilot.GUIDED, ardupilot.HOLD, ardupilot.GUIDED]
    autopilot.target((1.0, 0.0))
    assert rover.drive is MotorDrive.STOP
    rover.step(3.0)
    assert list(autopilot.step()) == [ModeAnswer(ardupilot.HOLD, accepted=True)]
    assert autopilot.mode == ardupilot.HOLD


def test_the_script_stops_where_targets_do_not_come() -> None:
    rover = Rover(Trail(1), cruise_speed=1.0)
    autopilot = ScriptedAutopilot(rover, Random(1), 2.0)
    autopilot.request(SetMode(ardupilot.GUIDED, ardupilot.AUTO), guide=True)
    for _ in range(200):
        rover.step(STEP)
        list(autopilot.step())
    assert autopilot.mode == ardupilot.HOLD


def test_by_true_labels_hold_stops_before_the_first_thing_which_report_touches_and_guide_passes(
    routes: list[FieldRoute],
) -> None:
    route = next(one for one in routes if one.placed[0].kind == "round")
    metres = route.placed[0].s - route.begin + 2.0
    report, hold, guide = drive_all(
        route.seed, ("report", "hold", "guide"), truth=True, metres=metres, size=(160, 120)
    )
    assert len(report.contacts) == 1
    assert report.driven == pytest.approx(metres)
    assert (hold.contacts, hold.stood, hold.asked) == ([], True, 1)
    assert hold.driven < metres - 2.0
    assert (guide.contacts, guide.stood, guide.asked, guide.takeovers) == ([], False, 0, 1)


def test_the_last_line_is_one_json_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = lambda seed, policies, truth: [DriveResult(one, seed, 60.0, driven=60.0) for one in policies]  # noqa: E731, ARG005
    monkeypatch.setattr(bench_field, "drive_all", made)
    assert bench_field.main(["--runs", "2", "--jobs", "1"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["hold"]["runs"] == 2
    wanted = "runs contacts route_share passed_share asked stood needless_stops_per_100m edge_min_m takeovers"
    assert {*wanted.split(), "human_overrides", "late"} <= set(told["report"])
