"""How large a tile is: what a rock fills at stopping distance, within bounds, and told in words."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.ground import GroundCamera
from anytraverse.judging import LARGEST_TILE, Settings
from anytraverse.perception import DefaultThresholds, Perceiver
from companion.config import Config
from companion.config.schema import CameraSection, MountSection, RoiSection, StoppingSection
from companion.config.stopping import (
    ROCK,
    describe_tile,
    judge_stopping,
    tile_width,
    with_settings,
)
from companion.config.stopping import Stopping as Judged
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate
from companion.daemon.settings.runtime import tuned
from companion.vision.warm_up import judging_settings
from companion.wire.parameters import ROI

CONFIG = Config(
    camera=CameraSection(view=75.0),
    mount=MountSection(height=0.8, tilt=10.0, front=0.3),
    stopping=StoppingSection(speed=1.0, time_constant=1.76, braking=6.46),
    roi=RoiSection(0.333, 0.6, 0.667, 0.95),
)
SMALL = DefaultThresholds(0.3, 0.86, 0.9, tile_share=0.08)
MOUNTS = st.builds(
    MountSection,
    height=st.floats(0.05, 20),
    tilt=st.floats(-45, 85),
    aspect=st.floats(0.3, 5),
    front=st.floats(0, 20),
)
VIEWS = st.floats(10, 120)
SPEEDS = st.floats(0.05, 30)


def settings_of(config: Config, own: DefaultThresholds = SMALL) -> Settings:
    """The settings that the vision process and `companion check` make of a configuration."""
    return judging_settings(config, cast(Perceiver, SimpleNamespace(defaults=own)))


def configured(mount: MountSection, view: float, speed: float) -> Config:
    """A rover with this camera, at this speed."""
    camera, stopping = replace(CONFIG.camera, view=view), replace(CONFIG.stopping, speed=speed)
    return replace(CONFIG, mount=mount, camera=camera, stopping=stopping)


@given(MOUNTS, VIEWS, SPEEDS, st.floats(0.05, 1))
@settings(max_examples=150)
def test_whatever_the_mount_a_tile_is_from_the_perceivers_own_to_a_quarter_of_the_roi(
    mount: MountSection, view: float, speed: float, own: float
) -> None:
    config = configured(mount, view, speed)
    width = tile_width(config)
    assert width is not None
    assert math.isfinite(width)
    assert 0.0 < width <= 1.0
    side = settings_of(config, replace(SMALL, tile_share=own)).tile_side
    assert own <= side <= max(own, LARGEST_TILE)


@given(MOUNTS, VIEWS, SPEEDS, st.floats(1.01, 3))
@settings(max_examples=100)
def test_a_faster_vehicle_never_has_a_larger_tile(
    mount: MountSection, view: float, speed: float, by: float
) -> None:
    slow, fast = configured(mount, view, speed), configured(mount, view, speed * by)
    one, other = tile_width(slow), tile_width(fast)
    assert one is not None
    assert other is not None
    assert other <= one
    assert other < one or one == 1.0
    assert settings_of(fast).tile_side <= settings_of(slow).tile_side


@given(
    st.floats(0.05, 20),
    st.floats(0, 85),
    VIEWS,
    st.floats(0.3, 5),
    st.floats(0.01, 5),
    st.floats(0.01, 50),
    st.floats(1.01, 3),
)
@settings(max_examples=100)
def test_a_thing_that_is_farther_appears_narrower_and_its_width_tells_how_far_it_is(
    height: float, tilt: float, view: float, aspect: float, metres: float, distance: float, by: float
) -> None:
    camera = GroundCamera.pinhole(height, tilt, view, aspect)
    near, far = camera.width(metres, distance), camera.width(metres, distance * by)
    assert 0.0 < far < near < math.inf
    assert camera.farthest(metres, near) == pytest.approx(distance, abs=1e-6 * (1 + height + distance))


def test_a_thing_appears_as_wide_as_trigonometry_says() -> None:
    assert GroundCamera.pinhole(0.0, 0.0, 90.0, 1.333).width(1.0, 2.0) == pytest.approx(0.25)
    assert GroundCamera.pinhole(1.0, 45.0, 90.0, 1.333, front=0.5).width(1.0, 0.5) == pytest.approx(
        0.5 / math.sqrt(2.0)
    )


def test_a_thing_beside_or_behind_the_lens_is_as_wide_as_the_picture_and_more() -> None:
    assert GroundCamera.pinhole(3.0, -45.0, 60.0, 1.333).width(0.45, 2.0) == math.inf
    behind = configured(MountSection(20.0, -45.0), 60.0, 0.1)
    assert tile_width(behind) == 1.0
    assert settings_of(behind).tile_side == LARGEST_TILE


def test_the_square_inside_a_round_rock_at_the_distance_of_check_is_a_tile() -> None:
    judged = judge_stopping(CONFIG)
    assert isinstance(judged, Judged)
    rock = GroundCamera.pinhole(0.8, 10.0, 75.0, 1.333, 0.3).width(ROCK, judged.needs)
    width = tile_width(CONFIG)
    assert width == pytest.approx(rock / math.sqrt(2.0))
    assert settings_of(CONFIG).tile_side == pytest.approx(rock / math.sqrt(2.0) / (0.667 - 0.333))
    assert 0.08 < settings_of(CONFIG).tile_side < LARGEST_TILE


def test_a_quick_perceiver_is_assumed_so_that_everybody_reckons_with_the_same_distance() -> None:
    one, other = judge_stopping(CONFIG), judge_stopping(CONFIG, step=0.2)
    assert isinstance(one, Judged)
    assert isinstance(other, Judged)
    assert one.needs == other.needs


@pytest.mark.parametrize(
    "config",
    [
        Config(),
        replace(CONFIG, mount=MountSection()),
        replace(CONFIG, stopping=StoppingSection()),
        replace(CONFIG, camera=CameraSection(view=121.0)),
    ],
)
def test_without_mount_speed_or_a_pinholes_view_the_perceivers_own_tile_is_used(config: Config) -> None:
    assert tile_width(config) is None
    assert settings_of(config).tile_side == 0.08
    text, in_time = describe_tile(config, settings_of(config))
    assert "the perceiver's own; to calculate it: " in text
    assert in_time, "nothing is known against it"


@pytest.mark.parametrize("share", [0.05, 0.2, 0.6])
def test_a_configured_number_wins_over_mount_and_perceiver(share: float) -> None:
    config = replace(CONFIG, roi=replace(CONFIG.roi, tile_share=share))
    assert settings_of(config).tile_side == share
    assert describe_tile(config, settings_of(config))[0].endswith("(set by [roi] tile_share)")


@given(st.floats(0, 0.9), st.floats(0.1, 1))
@settings(max_examples=60)
def test_a_region_that_the_ground_sets_changes_no_tile_but_by_a_bound(left: float, width: float) -> None:
    right = min(1.0, left + width)
    before = settings_of(CONFIG)
    after = tuned(before, {ROI["left"]: left, ROI["right"]: right}, misfit_allowed=True)
    side = after.tile_side * (right - left)
    assert 0.08 <= after.tile_side <= LARGEST_TILE
    if 0.08 < after.tile_side < LARGEST_TILE:
        assert side == pytest.approx(tile_width(CONFIG))


@pytest.mark.parametrize("share", [None, 0.1])
def test_the_hold_gate_sees_with_the_tile_in_force(share: float | None) -> None:
    config = replace(CONFIG, roi=replace(CONFIG.roi, tile_share=share))
    judging = settings_of(config)
    found = HoldGate(config).stopping(HoldConditions(judging, 0.05))
    assert isinstance(found, Judged)
    lower = 0.6 + judging.tile_side * (0.667 - 0.333) * 1.333
    assert found.sees == pytest.approx(GroundCamera.pinhole(0.8, 10.0, 75.0, 1.333, 0.3).distance(lower))
    assert found == judge_stopping(with_settings(config, judging), 0.05, 0.9)


def test_a_tile_is_told_in_pixels_and_as_a_rock_at_its_distance() -> None:
    text, in_time = describe_tile(CONFIG, settings_of(CONFIG))
    assert text == (
        "a tile is 31 px wide in a picture of 640 = a 45 cm rock at 3.9 m, and 1 m/s takes 3.9 m to stop"
    )
    assert in_time
    wide = replace(CONFIG, camera=replace(CONFIG.camera, width=1280, height=960))
    assert describe_tile(wide, settings_of(wide))[0].startswith("a tile is 62 px wide in a picture of 1280")


def test_a_slower_vehicle_is_told_that_a_rock_fills_its_tile_before_it_must_stop() -> None:
    slow = replace(CONFIG, stopping=replace(CONFIG.stopping, speed=0.3))
    text, in_time = describe_tile(slow, settings_of(slow))
    assert "a 45 cm rock at 2.1 m, and 0.3 m/s takes 1.2 m to stop" in text
    assert in_time


def test_a_vehicle_too_fast_for_the_perceivers_smallest_tile_is_told_so() -> None:
    fast = replace(CONFIG, stopping=replace(CONFIG.stopping, speed=3.0))
    text, in_time = describe_tile(fast, settings_of(fast))
    assert settings_of(fast).tile_side == 0.08
    assert text.endswith(
        "such a rock is called later than that, drive slower or set a smaller [roi] tile_share"
    )
    assert not in_time
