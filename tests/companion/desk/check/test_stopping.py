"""Stopping before what the camera shows: the geometry, the speed that fits, and what is told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from anytraverse.ground import GroundCamera
from anytraverse.judging import Settings, Thresholds
from anytraverse.regions import Box
from companion.config import Config
from companion.config.schema import CallSection, CameraSection, MountSection, RoiSection, StoppingSection
from companion.config.stopping import FARTHEST, OVERSHOOT, Stopping, judge_stopping, tile_width
from companion.desk.check.autopilot import AutopilotReadings
from companion.desk.check.rover import CheckedRover, Perceives
from companion.desk.check.rules import Verdict
from companion.desk.check.stopping import check_stopping, check_tile
from companion.vehicle.brakes import ARDUPILOT, Brakes, fit

CAMERAS = st.builds(
    GroundCamera.pinhole,
    height=st.floats(0.1, 5),
    tilt=st.floats(-30, 80),
    view=st.floats(20, 120),
    aspect=st.floats(0.5, 3),
    front=st.floats(0, 3),
)
CONFIG = Config(
    camera=CameraSection(view=75.0, latency=0.0),
    mount=MountSection(height=1.0, tilt=7.0),
    stopping=StoppingSection(speed=1.0, time_constant=0.3, braking=1.4, delay=0.2),
    roi=RoiSection(0.35, 0.5, 0.65, 0.95),
)


def judged(
    config: Config, step: float = 0.0, tile: float | None = None, speed: float | None = None
) -> Stopping:
    """A judgement that there is."""
    found = judge_stopping(config, step, tile, speed)
    assert isinstance(found, Stopping), found
    return found


def at(speed: float, braking: float = 1.0, react: float = 1.5, sees: float = 8.0) -> Stopping:
    """Plain figures."""
    return Stopping(speed, Brakes.of(braking, 0.3), react, sees)


def test_the_axis_of_a_tilted_camera_meets_the_ground_where_trigonometry_says() -> None:
    assert GroundCamera.pinhole(1.0, 45.0, 60.0, 1.333).distance(0.5) == pytest.approx(1.0)
    assert GroundCamera.pinhole(1.0, 7.0, 75.0, 1.333).distance(0.5) == pytest.approx(8.14, abs=0.01)
    assert GroundCamera.pinhole(1.0, 7.0, 75.0, 1.333, front=0.6).distance(0.5) == pytest.approx(
        7.54, abs=0.01
    )


def test_the_lower_side_of_a_square_picture_looks_down_by_half_its_view() -> None:
    assert GroundCamera.pinhole(2.0, 0.0, 90.0, 1.0).distance(1.0) == pytest.approx(2.0)


@given(CAMERAS, st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=60)
def test_a_higher_row_never_sees_less_far(camera: GroundCamera, one: float, other: float) -> None:
    assert camera.distance(min(one, other)) >= camera.distance(max(one, other))


@given(CAMERAS, st.floats(0, 1))
@settings(max_examples=60)
def test_the_row_of_a_distance_is_the_row_that_it_came_from(camera: GroundCamera, row: float) -> None:
    distance = camera.distance(row)
    assume(0.0 < distance < 100.0)
    assert camera.row(distance) == pytest.approx(row, abs=1e-6)


FIGURES = st.builds(
    at, speed=st.floats(0.1, 10), braking=st.floats(0.1, 8), react=st.floats(0.1, 5), sees=st.floats(0.5, 20)
)


@given(FIGURES, st.floats(1.01, 3))
@settings(max_examples=60)
def test_a_faster_vehicle_needs_more_and_what_fits_does_not_depend_on_it(one: Stopping, by: float) -> None:
    faster = replace(one, speed=one.speed * by)
    assert faster.needs > one.needs
    assert faster.fits == one.fits
    assert one.enough or not faster.enough


@given(FIGURES)
@settings(max_examples=60)
def test_the_speed_that_it_says_fits_does_and_five_percent_more_does_not(one: Stopping) -> None:
    fits = one.fits
    assert replace(one, speed=fits * 0.999).enough
    assert not replace(one, speed=fits * 1.05).enough


@given(st.floats(0.05, 3), st.floats(-10, 40), st.floats(0.2, 8), st.floats(0, 0.8))
@settings(max_examples=60)
def test_the_upper_side_that_it_says_would_do_does(
    height: float, tilt: float, speed: float, top: float
) -> None:
    config = replace(
        CONFIG,
        mount=MountSection(height, tilt),
        stopping=replace(CONFIG.stopping, speed=speed),
        roi=replace(CONFIG.roi, top=top),
    )
    before = judged(config)
    if before.top is not None and before.top > 1e-6:
        assert judged(replace(config, roi=replace(config.roi, top=before.top - 1e-6))).enough


def test_a_thing_is_seen_where_it_fills_a_tile_and_not_at_the_upper_row() -> None:
    camera = GroundCamera.pinhole(1.0, 7.0, 75.0, 1.333)
    assert judged(CONFIG).sees == pytest.approx(camera.distance(0.5 + 0.25 * 0.3 * 1.333))
    assert judged(CONFIG).sees < camera.distance(0.5)


def test_a_lower_threshold_of_the_tile_sees_farther_as_less_of_it_must_be_filled() -> None:
    camera = GroundCamera.pinhole(1.0, 7.0, 75.0, 1.333)
    half = 0.5 * 0.25 * 0.3 * 1.333
    assert judged(CONFIG, tile=0.4).sees == pytest.approx(camera.distance(0.5 + half))
    for high in (0.8, 0.9, None):
        assert judged(CONFIG, tile=high).sees == judged(CONFIG).sees


def test_a_region_above_the_horizon_is_believed_no_farther_than_it_should() -> None:
    level = replace(CONFIG, mount=MountSection(height=1.0, tilt=-20.0), roi=replace(CONFIG.roi, top=0.3))
    assert GroundCamera.pinhole(1.0, -20.0, 75.0, 1.333).distance(0.4) == math.inf
    assert judged(level).sees == FARTHEST


def test_the_time_to_react_is_the_votes_or_t_and_the_way_to_the_brakes() -> None:
    assert judged(CONFIG).react == pytest.approx(1.0 + 0.2), "T takes longer than three frames"
    assert judged(CONFIG, step=0.05).react == pytest.approx(1.0 + 0.2)
    assert judged(CONFIG, step=0.4).react == pytest.approx(0.4 + 3 * 0.4 + 0.2), "a slow perceiver's rate"


def test_the_camera_s_latency_is_driven_blindly() -> None:
    late = replace(CONFIG, camera=replace(CONFIG.camera, latency=0.5))
    assert judged(late).react == pytest.approx(judged(CONFIG).react + 0.5)
    assert judged(late).needs == pytest.approx(judged(CONFIG).needs + 0.5 * OVERSHOOT)
    assert judged(late).fits < judged(CONFIG).fits


def test_it_is_reckoned_to_drive_faster_than_it_is_told() -> None:
    one = at(2.0, react=1.0)
    assert one.driven == pytest.approx(2.24)
    assert one.needs == pytest.approx(2.24 + 0.3 * 2.24 + 2.24**2 / 2.0)


def test_an_old_braking_figure_promises_no_shorter_way_than_ardupilot_took() -> None:
    for measured in ARDUPILOT:
        figure = measured.speed**2 / (2.0 * measured.way)
        for speed, way in ARDUPILOT:
            old = replace(
                CONFIG, stopping=StoppingSection(speed=speed / OVERSHOOT, braking=figure, delay=0.0)
            )
            assert judged(old).needs >= speed * judged(old).react + way


def test_what_was_fitted_is_believed_at_every_speed() -> None:
    found = fit(ARDUPILOT)
    fitted = StoppingSection(speed=1.0, time_constant=found.time_constant, braking=found.braking, delay=0.0)
    lone = StoppingSection(speed=1.0, braking=found.braking, delay=0.0)
    assert judged(replace(CONFIG, stopping=fitted)).needs < judged(replace(CONFIG, stopping=lone)).needs


def test_the_greater_of_the_configured_speed_and_the_autopilot_s_counts() -> None:
    assert judged(CONFIG, speed=2.5).speed == 2.5
    assert judged(CONFIG, speed=0.5).speed == 1.0
    assert judged(replace(CONFIG, stopping=StoppingSection()), speed=0.5).speed == 0.5


def test_what_outruns_its_eyes_is_told_the_speed_and_the_row_that_would_do() -> None:
    told = judged(CONFIG, speed=2.5).describe()
    for part in (
        "at 2.5 m/s",
        "to stop",
        "drive at most 1.69",
        "or set [roi] top = 0.41 (further up the picture)",
        "[call] freshness",
    ):
        assert part in told, told
    assert "fits up to 1.69" in judged(CONFIG).describe()


def test_what_is_driven_on_in_the_mode_that_holds_comes_on_top_and_has_a_remedy_of_its_own() -> None:
    straight, circling = judged(CONFIG), judge_stopping(CONFIG, overrun=2.5)
    assert isinstance(circling, Stopping)
    assert circling.needs == pytest.approx(straight.needs + 2.5)
    assert replace(circling, speed=circling.fits * 0.999).enough
    assert not replace(circling, speed=circling.fits * 1.05).enough
    assert "then 2.5 m on in LOITER" in circling.describe()
    assert 'px4_hold = "offboard"' in replace(circling, speed=3.0).describe()
    assert "LOITER" not in straight.describe() + replace(straight, speed=5.0).describe()
    assert at(1.0, sees=2.0).fits > 0.0 == replace(at(1.0, sees=2.0), overrun=2.5).fits


def test_what_stands_before_nothing_can_be_seen_is_not_told_a_speed_of_nought() -> None:
    blind = replace(CONFIG, mount=MountSection(1.0, 80.0, front=3.0))
    assert judged(blind).sees == 0.0
    assert "no speed is slow enough: mount the camera" in judged(blind).describe()


@pytest.mark.parametrize(
    ("config", "missing"),
    [
        (Config(), "set [mount] height and tilt, and [stopping] speed"),
        (replace(Config(), stopping=StoppingSection(speed=1.0)), "set [mount] height and tilt"),
        (replace(CONFIG, stopping=StoppingSection()), "set [stopping] speed"),
        (replace(CONFIG, camera=CameraSection(view=170.0)), "no pinhole"),
    ],
)
def test_what_cannot_be_judged_says_what_is_missing(config: Config, missing: str) -> None:
    told = judge_stopping(config)
    assert isinstance(told, str)
    assert missing in told


def rover_with(folder: Path, config: Config, judging: Settings | None) -> CheckedRover:
    """A rover whose perceiver is loaded, and whose autopilot has said nothing."""
    rover = CheckedRover(config, "", folder)
    trouble = "" if judging is not None else "no such model"
    rover.__dict__["perceives"] = Perceives(trouble, "painted-1", 0.05, judging)
    rover.__dict__["asked"] = AutopilotReadings()
    return rover


@pytest.mark.parametrize(
    ("speed", "verdict", "said"),
    [
        (1.0, Verdict.PASS, "a tile is 35 px wide in a picture of 640 = a 45 cm rock at 3.7 m"),
        (3.0, Verdict.WARN, "such a rock is called later than that"),
    ],
)
def test_the_row_of_the_tile_tells_how_large_it_is_and_whether_a_rock_fills_it_in_time(
    tmp_path: Path, speed: float, verdict: Verdict, said: str
) -> None:
    stopping = StoppingSection(speed=speed, time_constant=1.76, braking=6.46)
    config = replace(CONFIG, stopping=stopping)
    judging = Settings(tile_share=0.08, tile_width=tile_width(config))
    (found,) = check_tile(rover_with(tmp_path, config, judging))
    assert (found.check, found.verdict) == ("tile", verdict)
    assert said in found.text


def test_a_tile_is_not_told_without_a_perceiver_or_beside_a_companion_that_runs(tmp_path: Path) -> None:
    unloaded = rover_with(tmp_path, CONFIG, None)
    beside = CheckedRover(CONFIG, "", tmp_path, running={})
    for rover in (unloaded, beside):
        (found,) = check_tile(rover)
        assert (found.check, found.verdict) == ("tile", Verdict.SKIP)


def test_a_region_that_the_vehicle_does_not_fit_in_fails_the_row_of_the_tile(tmp_path: Path) -> None:
    narrow = Settings(region=Box(0.46, 0.6, 0.54, 0.95), misfit_allowed=True)
    (found,) = check_tile(rover_with(tmp_path, CONFIG, narrow))
    assert (found.check, found.verdict) == ("tile", Verdict.FAIL)
    assert found.text.startswith("ROI 0.08 wide, vehicle 0.30: widen it, or correct [roi] or [corridor]")


def test_the_row_of_the_stopping_distance_sees_with_the_tile_in_force(tmp_path: Path) -> None:
    small = Settings(region=Box(0.35, 0.5, 0.65, 0.95), tile_share=0.08, thresholds=Thresholds(tile=0.9))
    (found,) = check_stopping(rover_with(tmp_path, CONFIG, small))
    lower = 0.5 + 0.08 * 0.3 * 1.333
    assert (
        f"a thing is seen {GroundCamera.pinhole(1.0, 7.0, 75.0, 1.333).distance(lower):.1f} m ahead"
        in found.text
    )


@pytest.mark.parametrize("judging", [None, Settings(region=Box(0.35, 0.5, 0.65, 0.95))])
def test_the_row_of_the_stopping_distance_counts_a_take_over_that_fails_with_policy_guide(
    tmp_path: Path, judging: Settings | None
) -> None:
    told = {}
    for policy in ("hold", "guide"):
        config = replace(CONFIG, call=CallSection(policy=policy, window=10))
        (found,) = check_stopping(rover_with(tmp_path, config, judging))
        told[policy] = float(found.text.split("it takes ")[1].split(" m to stop")[0])
    assert told["guide"] == pytest.approx(told["hold"] + 0.5 * OVERSHOOT * 1.0, abs=0.11)
