"""Which calls repeat, what counts as noticed, and the figures of the line."""

from __future__ import annotations

from dataclasses import replace

from bench.calls import beside, plot, real, route, trail
from bench.calls.engines import alone, of_the_field
from bench.calls.jobs import JobResult, PartJob, told
from bench.calls.operators import OPERATORS, AnsweredCall
from companion.desk.drives.judge import DriveJudge

SCENE = AnsweredCall(1.0, 2.0, ("unknown_scene",), (None, "forest"), repeat=False, words=True)
THING = AnsweredCall(2.0, 4.0, ("unknown_object",), ("drum-1", None), repeat=False, words=True)


def answered(calls: list[AnsweredCall]) -> dict[str, list[AnsweredCall]]:
    """The same calls for every operator."""
    return {name: list(calls) for name in OPERATORS}


def test_the_figures_of_a_trail_count_calls_by_metres_and_repeats_by_calls() -> None:
    laps = [
        (100.0, answered([THING, replace(THING, repeat=True)])),
        (50.0, answered([SCENE])),
    ]
    assert trail.figures(laps)["tap"] == {"calls": 3, "calls_per_100m": 2.0, "repeats": 1}


def test_the_second_pass_counts_by_itself_and_the_last_half_of_the_first_too() -> None:
    calls = [SCENE, replace(SCENE, at=30.0, words=False), THING, replace(SCENE, at=3605.0)]
    found = real.figures(real.Driven(100, 25.0, 3600.0, answered(calls), 40, (True, False, False, False)))
    assert found["word"] == {
        "calls_per_100": 3.0,
        "last_half_per_100": 2.0,
        "second_pass_per_100": 1.0,
        "without_new_word": 0.5,
        "scene_calls": 2,
        "object_calls": 1,
    }
    assert found["go"]["without_new_word"] is None


def test_foreign_frames_that_pass_as_known_are_a_share_beside_the_count_of_remembered_scenes() -> None:
    driven = real.Driven(100, 25.0, 3600.0, answered([]), 40, (True, False, False, False))
    found = real.foreign_known(driven)
    assert found is not None
    assert (found["value"], found["of"], found["scenes"]) == (0.25, 4, 40)
    assert real.foreign_known(replace(driven, foreign=())) is None


def test_the_last_line_holds_each_part_and_says_what_is_left_out() -> None:
    lap = (10.0, answered([THING]))
    done = [
        JobResult(PartJob("trail", "", None), lap, 1.5),
        JobResult(PartJob("trail_untuned", "", None), lap, 2.0),
    ]
    line = told(done, {"real": "needs frames"})
    assert line["trail"] == line["trail_untuned"] == trail.figures([lap])
    assert line["left_out"] == {"real": "needs frames"}
    assert line["seconds"] == {"trail": 1.5, "trail_untuned": 2.0}


def test_a_second_thing_counts_as_noticed_only_where_the_first_alone_does_not_call_again() -> None:
    noticed, again, quiet = (
        beside.ApproachRun(10, stopped=12),
        beside.ApproachRun(10, stopped=11),
        beside.ApproachRun(10),
    )
    assert beside.outcome("go", noticed, quiet) is True
    assert beside.outcome("go", quiet, quiet) is False
    assert beside.outcome("go", noticed, again) is None
    assert beside.outcome("go", beside.ApproachRun(), quiet) is None
    assert beside.outcome("tap", replace(quiet, holds=True), quiet) is True
    assert beside.outcome("tap", quiet, quiet) is False


def test_a_route_counts_what_is_asked_beyond_one_call_a_thing_and_one_a_place() -> None:
    lap = route.LapResult(
        500.0, 400.0, [THING, SCENE, replace(THING, repeat=True)], due=2, contacts=["drum-1"]
    )
    found = route.figures({"first": lap, "second": route.LapResult(500.0)})
    assert found["first"]["calls_per_km"] == 6.0
    assert found["first"]["operator_s_per_km"] == 60.0
    assert found["first"]["surplus_share"] == 0.333
    assert found["first"]["contacts"] == 1
    assert found["second"]["calls_per_km"] == found["second"]["surplus_share"] == 0.0


def test_a_rover_on_the_route_asks_about_what_lies_there_and_touches_nothing() -> None:
    config = of_the_field(route.RATE, route.SPEED)
    film, lap = next(route.Worlds(1, 120.0).each()), route.LapResult()
    pose = film.world.trail.pose(film.world.trail.start + 14.0)
    film.world.move("drum-1", pose.x, pose.y)
    route.RouteRover(film, DriveJudge(config, alone(config)), lap, set(), route.RouteClock()).drive(17.0)
    assert lap.metres == 17.0
    assert lap.calls
    assert lap.taken == 1
    assert lap.contacts == []


def test_the_plot_holds_both_passes_and_the_lines_of_the_paper() -> None:
    calls = answered([SCENE, replace(SCENE, at=3601.0)])
    lines = plot.series(calls, 100, real.RATE, 3600.0).lines
    assert lines["go"][-1][:2] == [200, 2.0]
    assert [point[1] for point in lines["tap"] if point[0] == 100] == [1.0]
    assert lines["15 %"][-1][1] == 30.0
    drawn = plot.drawn(lines)
    assert drawn.startswith("<svg ")
    assert "var(" not in drawn
    assert "15 %" in drawn
