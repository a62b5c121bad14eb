"""Where a person stands for `companion check --zone`, and what the marks mean for the rover's stop."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.judging import Settings, Thresholds
from anytraverse.regions import Box
from companion.config import Config
from companion.config.schema import CameraSection, MountSection, StoppingSection
from companion.config.stopping import Stopping, judge_stopping
from companion.desk.check.autopilot import AutopilotReadings
from companion.desk.check.rover import CheckedRover, Perceives
from companion.desk.check.rules import CheckFinding, Verdict
from companion.desk.check.stopping import check_zone
from companion.desk.check.zone_file import Zone, ZoneMark, utc_now, write_zone
from companion.desk.check.zone_match import judged_by
from companion.desk.check.zone_plan import (
    WalkLine,
    typed_distances,
    verdicts,
    walk_distances,
    walk_lines,
)
from companion.desk.check.zone_report import conclusion, table
from companion.vehicle.brakes import Brakes

STOPS = Stopping(1.0, Brakes.of(0.5, 0.0), 0.5, 0.0)
AHEAD = WalkLine("ahead", 0.0, math.inf)
MOUNTED = Config(
    camera=CameraSection(view=75.0),
    mount=MountSection(height=1.0, tilt=7.0, width=0.6),
    stopping=StoppingSection(speed=1.0),
)


def mark(at: float, *, noticed: bool = True, line: WalkLine = AHEAD) -> ZoneMark:
    return ZoneMark(
        frames=10,
        noticed_frames=10 if noticed else 3,
        reasons=(),
        at=utc_now(),
        line=line.name,
        bearing_deg=line.bearing,
        distance_m=at,
        noticed=noticed,
        in_picture=True,
        elsewhere=False,
    )


def zone(*marks: ZoneMark, distances: tuple[float, ...] = (1.0, 2.0, 3.0)) -> Zone:
    stop = {"speed": STOPS.speed, "needs": STOPS.needs}
    empty: dict[str, float | None] = {}
    return Zone(
        at=utc_now(),
        program="0",
        identity="x",
        model="m",
        words={},
        thresholds=empty,
        region=empty,
        mount=empty,
        stop=stop,
        thing="box",
        distances=distances,
        verdict="",
        clear=True,
        marks=marks,
        arcs=(),
    )


def test_lines_run_along_the_picture_s_edges_the_sides_of_the_way_and_straight_ahead() -> None:
    lines = walk_lines(MOUNTED, 3.0)
    bearings = [one.bearing for one in lines]
    assert bearings == sorted(bearings)
    assert bearings == [-one for one in reversed(bearings)]
    assert 0.8 * 37.5 < bearings[-1] < 37.5, "in the picture"
    side = lines[3]
    assert side.point(3.0)[1] == pytest.approx(0.3, abs=0.01), "the vehicle's side, where it stops"
    assert side.in_way(3.0)
    assert not lines[4].in_way(1.0)


def test_a_camera_that_looks_aside_has_its_lines_where_it_looks() -> None:
    aside = replace(MOUNTED, mount=replace(MOUNTED.mount, heading=40.0))
    assert [one.bearing for one in walk_lines(aside, None)][2] == 40.0
    assert walk_lines(aside, None)[0].bearing == pytest.approx(40.0 - 0.9 * 37.5, abs=0.1)


def test_marks_hold_the_stopping_distance_and_one_beyond_the_region() -> None:
    assert walk_distances((), 3.17, 0.5, 4.3) == (1.0, 2.0, 3.2, 4.0, 6.0)
    assert walk_distances((), None, None, None)[-1] == 20.0
    assert walk_distances((), None, 1.4, 2.0) == (2.0, 3.0)


@given(st.floats(0.2, 60), st.floats(0, 3), st.floats(0.5, 6))
def test_some_mark_is_never_nearer_than_what_stopping_needs(needs: float, near: float, far: float) -> None:
    lines = walk_lines(MOUNTED, needs)
    found = walk_distances(lines, needs, near, far)
    assert list(found) == sorted(set(found))
    for line in lines:
        if line.in_way(line.needs(needs)):
            marks = [mark(one, line=line) for one in found]
            assert max(line.point(one.distance_m)[0] for one in marks) >= needs - 1e-5


def test_a_line_is_noticed_only_as_far_as_every_mark_nearer_is() -> None:
    marks = [mark(4.0), mark(3.0, noticed=False), mark(2.0), mark(1.0)]
    (found,) = verdicts([AHEAD], marks, (1.0, 2.0, 3.0, 4.0), STOPS)
    assert (found.noticed_to, found.gaps) == (2.0, (3.0,))


def test_a_mark_that_was_left_out_counts_as_not_noticed() -> None:
    (found,) = verdicts([AHEAD], [mark(3.0), mark(1.0)], (1.0, 2.0, 3.0), STOPS)
    assert (found.noticed_to, found.gaps, found.enough) == (1.0, (2.0,), False)
    assert verdicts([AHEAD], [], (1.0,), STOPS) == []


@given(st.floats(0.3, 20))
def test_at_the_speed_that_fits_the_zone_is_just_enough(reach: float) -> None:
    (found,) = verdicts([AHEAD], [mark(reach)], (), STOPS)
    assert found.speed is not None
    assert replace(STOPS, speed=found.speed).needs == pytest.approx(reach, rel=1e-5)
    assert found.enough is (STOPS.needs <= reach + 1e-6)


def test_a_speed_rests_on_no_mark_before_which_nobody_looked() -> None:
    far = (2.5, 20.0)
    assert STOPS.needs < far[0]
    (found,) = verdicts([AHEAD], [mark(one) for one in far], far, STOPS)
    assert found.enough
    assert found.speed is not None
    assert replace(STOPS, speed=found.speed).needs == pytest.approx(2.5, rel=1e-5)


@pytest.mark.parametrize(
    ("typed", "metres"),
    [
        ("1 2 3.5", (1.0, 2.0, 3.5)),
        ("3, 2;1", (1.0, 2.0, 3.0)),
        ("1,5 1,50", (1.5,)),
        ("1_0", ()),
        ("two", ()),
        ("-1", ()),
        ("0.01", ()),
        ("101", ()),
        ("nan", ()),
        (" ".join(["1"] * 50), ()),
    ],
)
def test_typed_distances_have_spaces_between_and_a_comma_is_decimal(
    typed: str, metres: tuple[float, ...]
) -> None:
    assert typed_distances(typed, (), None) == metres


def test_the_mark_that_stopping_needs_stays_among_typed_ones() -> None:
    lines = walk_lines(MOUNTED, STOPS.needs)
    assert typed_distances("20", lines, 2.11) == (2.2, 20.0)


def test_a_camera_that_looks_backwards_has_bearings_that_a_file_may_hold() -> None:
    back = walk_lines(replace(MOUNTED, mount=replace(MOUNTED.mount, heading=180.0)), None)
    assert all(-180.0 <= one.bearing <= 180.0 for one in back)


def test_what_stands_beside_the_way_need_not_be_noticed_but_its_near_marks_must() -> None:
    beside = WalkLine("right edge", 34.0, 0.5)
    (found,) = verdicts([beside], [mark(1.0, noticed=False, line=beside)], (1.0,), STOPS)
    assert found.beside
    assert found.enough is None
    partly = WalkLine("right edge", 10.0, 1.5)
    for noticed in (True, False):
        marks = [mark(1.0, noticed=noticed, line=partly), mark(2.0, noticed=False, line=partly)]
        (found,) = verdicts([partly], marks, (1.0, 2.0), STOPS)
        assert found.enough is noticed


def test_the_conclusion_fails_closed() -> None:
    lines = (WalkLine("left side", -5.0, 9.0), AHEAD)
    far = [mark(one) for one in (1.0, 2.0, 3.0)]
    judged = verdicts(lines, far, (1.0, 2.0, 3.0), STOPS)
    text, covers = conclusion(zone(*far), lines, judged)
    assert covers is None, "a side was not measured"
    assert "measure left side, too" in text
    text, covers = conclusion(zone(*far), (AHEAD,), judged)
    assert covers is True
    assert "covers that, and up to" in text
    for clear in (None, False):
        text, covers = conclusion(replace(zone(*far), clear=clear), (AHEAD,), judged)
        assert covers is None, "the empty ground may have stopped it"
        assert "empty ground" in text
    near = [mark(1.0), mark(2.0, noticed=False), mark(3.0, noticed=False)]
    (short,) = verdicts([AHEAD], near, (1.0, 2.0, 3.0), STOPS)
    text, covers = conclusion(zone(*near), (AHEAD,), [short])
    assert covers is False
    assert "too short (ahead): measure again at 0.69 m/s at most" in text
    rows = list(table(zone(*near), [short]))
    assert "yes    30 %    30 %" in rows[1]
    assert "TOO SHORT" in rows[1]


def test_the_sides_of_a_vehicle_of_unknown_width_are_not_judged() -> None:
    lines = walk_lines(replace(MOUNTED, mount=replace(MOUNTED.mount, width=None)), 2.0)
    distances = walk_distances(lines, STOPS.needs, None, None)
    marks = [mark(one, line=line) for line in lines for one in distances]
    judged = verdicts(lines, marks, distances, STOPS)
    assert [one.enough for one in judged] == [None, None, True, None, None]
    text, covers = conclusion(zone(*marks, distances=distances), lines, judged)
    assert covers is None
    assert "set [mount] width" in text


def row(folder: Path, config: Config = MOUNTED, **told: Any) -> CheckFinding:
    """The row `zone`; told: attributes of what the perceiver and the autopilot tell."""
    rover = CheckedRover(config, "", folder, told.pop("running", None))
    rover.__dict__["perceives"] = Perceives("", told.pop("model", "m"), 0.05, told.pop("judging", JUDGING))
    rover.__dict__["asked"] = AutopilotReadings(**told)
    (found,) = check_zone(rover)
    return found


JUDGING = Settings(region=Box(0.35, 0.5, 0.65, 0.95))
NEEDED = judge_stopping(MOUNTED, 0.05)
assert isinstance(NEEDED, Stopping)
COVERED = replace(
    zone(mark(1.0)),
    covers=True,
    verdict="the zone covers that",
    words=dict(MOUNTED.preferences),
    stop={"speed": 1.0, "needs": NEEDED.needs},
    **judged_by(MOUNTED, JUDGING),
)


def test_the_check_shows_the_newest_zone_and_warns_where_it_holds_no_more(tmp_path: Path) -> None:
    assert row(tmp_path).verdict is Verdict.SKIP
    path = write_zone(tmp_path, COVERED)
    assert row(tmp_path).verdict is Verdict.PASS, row(tmp_path).text
    faster = row(tmp_path, replace(MOUNTED, stopping=StoppingSection(speed=2.0)))
    assert faster.verdict is Verdict.WARN
    assert "m at 2 m/s: measure again" in faster.text
    write_zone(tmp_path, replace(COVERED, covers=None))
    assert row(tmp_path).verdict is Verdict.WARN
    path.write_text("rubbish")
    assert row(tmp_path).verdict is Verdict.WARN
    assert "is left out" in row(tmp_path).text


def test_the_check_counts_overrun_and_speed_of_the_autopilot_against_the_zone(tmp_path: Path) -> None:
    write_zone(tmp_path, COVERED)
    for told in ({"overrun": 2.5}, {"speed": ("WP_SPEED", 1.5)}):
        found = row(tmp_path, **told)
        assert found.verdict is Verdict.WARN, told
        assert "; now it takes" in found.text


@pytest.mark.parametrize(
    ("what", "config", "told"),
    [
        ("mount", replace(MOUNTED, mount=replace(MOUNTED.mount, height=1.3)), {}),
        ("mount", replace(MOUNTED, mount=replace(MOUNTED.mount, height=1.3)), {"running": {}}),
        ("model", MOUNTED, {"model": "other, int8: quicker"}),
        ("model", MOUNTED, {"running": {"perceiver": {"model": "other"}}}),
        ("words", replace(MOUNTED, words={"lava": -1.0}), {}),
        ("words", MOUNTED, {"running": {"words": "lava: -1"}}),
        ("region", MOUNTED, {"judging": replace(JUDGING, region=Box(0.3, 0.5, 0.65, 0.95))}),
        ("thresholds", MOUNTED, {"judging": replace(JUDGING, thresholds=Thresholds(roi=0.9))}),
    ],
)
def test_the_check_warns_of_a_zone_that_was_judged_by_something_else(
    tmp_path: Path, what: str, config: Config, told: dict[str, Any]
) -> None:
    write_zone(tmp_path, COVERED)
    found = row(tmp_path, config, **told)
    assert found.verdict is Verdict.WARN
    assert f"with another {what}: measure again" in found.text


def test_the_check_passes_a_zone_with_the_words_of_the_companion_that_runs(tmp_path: Path) -> None:
    write_zone(tmp_path, replace(COVERED, words={"grass": 1.0, "rock": -0.5}))
    told = {"perceiver": {"model": "m"}, "words": "rock: -0.5; grass: 1"}
    assert row(tmp_path, running=told).verdict is Verdict.PASS


def test_nothing_is_concluded_where_the_stopping_distance_is_not_known() -> None:
    (found,) = verdicts([AHEAD], [mark(1.0)], (1.0,), None)
    assert (found.enough, found.beside) == (None, False)
    told = replace(zone(mark(1.0)), stop={"speed": None, "needs": None})
    assert conclusion(told, (AHEAD,), [found])[1] is None
