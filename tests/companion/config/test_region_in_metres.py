"""The region of interest in metres: by which rule it follows from the vehicle, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from anytraverse.errors import SettingsError
from anytraverse.ground import RELIABLE
from anytraverse.judging import Settings
from anytraverse.perception import make_perceiver
from companion.config import Config, ConfigError, load_config
from companion.config.schema import CameraSection, MountSection, RoiSection, StoppingSection
from companion.config.stopping import (
    Stopping,
    describe_tile,
    ground_region,
    judge_stopping,
    with_settings,
)
from companion.daemon.settings.runtime import tuned
from companion.vision.warm_up import judging_settings
from companion.wire.parameters import ROI

CONFIG = Config(
    camera=CameraSection(view=75.0, latency=0.1),
    mount=MountSection(height=1.0, tilt=7.0, front=0.3, width=0.6),
    stopping=StoppingSection(speed=0.8, time_constant=0.3, braking=1.4, delay=0.2),
)


def judged(config: Config, speed: float | None = None) -> Stopping:
    found = judge_stopping(config, speed=speed)
    assert isinstance(found, Stopping), found
    return found


def in_force(config: Config) -> Settings:
    return judging_settings(config, make_perceiver("builtin:lexicon"))


def test_it_ends_behind_what_stopping_needs_and_is_wider_than_the_vehicle() -> None:
    ground = ground_region(CONFIG)
    assert ground is not None
    assert ground.far == pytest.approx(1.2 * judged(CONFIG).needs + 0.5)
    assert ground.width == pytest.approx(1.2)
    assert ground.near == pytest.approx(ground.camera.nearest(1.2)), "nothing nearer is in the picture"


def test_what_is_configured_counts_instead() -> None:
    ground = ground_region(replace(CONFIG, roi=RoiSection(near=2.0, far=4.0, width=2.0)))
    assert ground is not None
    assert (ground.near, ground.far, ground.width) == (2.0, 4.0, 2.0)


@pytest.mark.parametrize(
    "unknown",
    [
        {"mount": MountSection(height=1.0, tilt=7.0)},
        {"mount": MountSection(width=0.6)},
        {"stopping": StoppingSection()},
        {"camera": CameraSection(view=150.0)},
    ],
)
def test_without_mount_width_speed_or_pinhole_there_is_none(unknown: dict[str, object]) -> None:
    config = replace(CONFIG, **unknown)  # type: ignore[arg-type]
    assert ground_region(config) is None
    assert in_force(config).ground is None


def test_a_thing_counts_as_seen_a_row_of_the_map_before_it_ends() -> None:
    ground = ground_region(CONFIG)
    assert ground is not None
    row = ground.camera.row(judged(CONFIG).sees) - ground.camera.row(ground.far)
    assert row == pytest.approx(1 / 48, abs=1e-4)
    assert judged(CONFIG).enough


def test_a_vehicle_that_needs_more_than_the_ground_is_known_to_does_not_stop_in_time() -> None:
    fast = replace(CONFIG, stopping=replace(CONFIG.stopping, speed=3.0))
    ground, found = ground_region(fast), judged(fast)
    assert ground is not None
    assert ground.far == pytest.approx(RELIABLE - 0.3)
    assert not found.enough
    assert 0.0 < found.fits < 3.0
    assert "drive at most" in found.describe()
    assert judged(replace(fast, stopping=replace(fast.stopping, speed=found.fits * 0.99))).needs <= found.sees


def test_the_region_follows_a_speed_that_the_autopilot_is_set_to_as_far_as_the_ground_is_known() -> None:
    assert judged(CONFIG).sees < judged(CONFIG, speed=1.2).sees < judged(CONFIG, speed=3.0).sees
    assert judged(CONFIG, speed=1.2).enough
    assert not judged(CONFIG, speed=3.0).enough
    assert judged(CONFIG, speed=0.5).sees == judged(CONFIG).sees, "the configured speed is the greater one"


def test_the_settings_in_force_have_it_and_its_box_in_the_picture() -> None:
    settings = in_force(CONFIG)
    assert settings.ground == ground_region(CONFIG)
    assert settings.region == settings.at(None).region.bounds
    assert not settings.misfit
    text, in_time = describe_tile(CONFIG, settings)
    assert in_time
    assert "1.2 m wide, a tile 0.4 m" in text
    assert judged(with_settings(CONFIG, settings)).sees == judged(CONFIG).sees


def test_a_side_that_the_ground_station_sets_makes_it_one_in_fractions() -> None:
    settings = tuned(in_force(CONFIG), {ROI["top"]: 0.55})
    assert settings.metres is None
    assert settings.at((3.0, 2.0)) is settings
    assert settings.region.bounds.top == 0.55
    assert judged(with_settings(CONFIG, settings)).sees != judged(CONFIG).sees
    assert settings.corridor == replace(in_force(CONFIG).at(None).corridor, gap=0.25, rows=None)


def test_sides_that_are_as_they_were_leave_it_in_metres() -> None:
    settings = in_force(CONFIG)
    asis = {name: round(getattr(settings.region.bounds, side), 6) for side, name in ROI.items()}
    assert tuned(settings, asis).metres == settings.ground
    assert tuned(settings, {ROI["top"]: asis[ROI["top"]]}).metres == settings.ground
    other = tuned(settings, {ROI["left"]: 0.1})
    assert other.metres is None
    assert tuned(other, {ROI["left"]: asis[ROI["left"]]}).metres == settings.ground


@pytest.mark.parametrize("mount", [{"heading": 40.0}, {"heading": 180.0}, {"tilt": -30.0}])
def test_a_mount_by_which_the_vehicle_fits_through_nowhere_is_refused(mount: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        ground_region(replace(CONFIG, mount=replace(CONFIG.mount, **mount)))


def written(folder: Path, mount: str, roi: str = "") -> Path:
    path = folder / "companion.toml"
    path.write_text(f'[vehicle]\nfile = ""\n[words]\ngrass = 1\n[mount]\n{mount}\n[roi]\n{roi}\n')
    return path


def test_a_file_whose_region_cannot_be_is_refused_with_what_to_look_at(tmp_path: Path) -> None:
    good = "height = 1.0\ntilt = 7.0\nwidth = 0.6\n"
    assert ground_region(load_config(written(tmp_path, good, "far = 4.0"))) is not None
    for mount, roi, why in (
        (good, "far = 4.0\nwidth = 0.4", "widen it"),
        (good, "far = 1.0", "holds no ground"),
        ("height = 1.0\ntilt = -40.0\nwidth = 0.6\n", "far = 4.0", "holds no ground"),
        (good, "near = 3.0\nfar = 2.0", "must be less than far"),
    ):
        with pytest.raises(ConfigError, match=why):
            load_config(written(tmp_path, mount, roi))
