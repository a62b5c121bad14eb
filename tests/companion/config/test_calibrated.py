"""[camera] calibration: the view, the aspect and the lens are those of the rectified picture."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from companion.cameras.calibration import LensCalibration
from companion.config import Config, ConfigError, format_config, load_config, recorded_config
from companion.config.stopping import Stopping, judge_stopping
from tests.companion.cameras.test_calibration import ROS

MOUNT = "[mount]\nheight = 1.0\ntilt = 10.0\n"
WIDE = ROS.replace("480", "360").replace("236.75", "176.75")


def _loaded(folder: Path, camera: str = "", more: str = "", lens: str = ROS) -> Config:
    (folder / "lens.yaml").write_text(lens)
    path = folder / "companion.toml"
    path.write_text(f'[vehicle]\nfile = ""\n{more}[camera]\ncalibration = "lens.yaml"\n{camera}')
    return load_config(path)


def _problem(folder: Path, camera: str = "", lens: str = ROS) -> str:
    with pytest.raises(ConfigError) as caught:
        _loaded(folder, camera, lens=lens)
    (problem,) = caught.value.problems
    return str(problem).replace(f"{folder}/", "")


def test_without_a_calibration_nothing_is_known_of_the_lens(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n')
    config = load_config(path)
    assert (config.calibration, config.intrinsics, config.camera_options.calibration) == (None, None, None)
    assert (config.camera.view, config.mount.aspect) == (60.0, 1.333)


def test_view_and_aspect_are_the_rectified_pictures(tmp_path: Path) -> None:
    config = _loaded(tmp_path, more=MOUNT)
    assert config.calibration is not None
    assert config.camera.calibration == str(tmp_path / "lens.yaml")
    assert config.camera.view == config.calibration.view == pytest.approx(81.76, abs=0.05)
    assert config.mount.aspect == pytest.approx(4 / 3, abs=1e-4)
    assert config.mount.height == 1.0
    assert config.camera_options.calibration == config.calibration
    assert _loaded(tmp_path, lens=WIDE).mount.aspect == pytest.approx(16 / 9, abs=1e-4)


def test_the_intrinsics_are_plain_numbers_over_width_and_height(tmp_path: Path) -> None:
    config = _loaded(tmp_path)
    assert config.intrinsics is not None
    assert all(type(one) is float for one in config.intrinsics)
    fx, fy, cx, cy = config.intrinsics
    assert 2.0 * math.degrees(math.atan(0.5 / fx)) == pytest.approx(config.camera.view)
    assert fy / fx == pytest.approx(config.mount.aspect, abs=1e-4)
    assert (cx, cy) == (0.5, 0.5)


def test_the_stopping_distance_is_that_of_the_calibrated_view(tmp_path: Path) -> None:
    config = _loaded(tmp_path, more=MOUNT + "[stopping]\nspeed = 1.0\n")
    judged = judge_stopping(config)
    assert isinstance(judged, Stopping)
    other = replace(config, camera=replace(config.camera, view=60.0))
    assert judged != judge_stopping(other)
    same = replace(config, calibration=None, camera=replace(config.camera, calibration=None))
    assert judged == judge_stopping(same)


def test_a_view_that_agrees_within_three_degrees_is_replaced(tmp_path: Path) -> None:
    assert _loaded(tmp_path, "view = 80\n").camera.view == _loaded(tmp_path).camera.view


def test_a_view_that_contradicts_the_calibration_is_a_problem(tmp_path: Path) -> None:
    assert _problem(tmp_path, "view = 60.0\n") == (
        "companion.toml:5: camera.view = 60.0: [camera] calibration makes it 81.76: take this line out, "
        "or calibrate again"
    )


def test_a_wrong_view_is_told_once(tmp_path: Path) -> None:
    assert "give a number from 10 to 180" in _problem(tmp_path, "view = 500\n")


@pytest.mark.parametrize("size", ["width = 320\nheight = 240\n", "width = 1280\nheight = 960\n"])
def test_a_size_of_the_same_shape_is_allowed(tmp_path: Path, size: str) -> None:
    assert _loaded(tmp_path, size).camera.view == _loaded(tmp_path).camera.view


def test_a_size_of_another_shape_is_a_problem(tmp_path: Path) -> None:
    told = _problem(tmp_path, "width = 1280\nheight = 720\n")
    assert told.startswith(
        "companion.toml:4: camera.calibration = 'lens.yaml': the pictures are 1280 x 720, "
    )
    assert "the calibration is of 640 x 480: calibrate in the shape of the pictures" in told


@pytest.mark.parametrize(
    ("lens", "told"),
    [
        ("rubbish", "lens.yaml has no image_width: name the file that the calibration wrote"),
        (ROS.replace("plumb_bob", "equidistant"), "lens.yaml is of a fisheye model, which is not rectified"),
    ],
)
def test_a_file_that_is_no_calibration_is_a_problem_with_its_line(
    tmp_path: Path, lens: str, told: str
) -> None:
    problem = _problem(tmp_path, lens=lens)
    assert problem.startswith(f"companion.toml:4: camera.calibration = 'lens.yaml': {told}")


def test_an_absent_file_is_told_with_all_other_problems(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[camera]\ncalibration = "none.yaml"\nrate = 0\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    first, second = sorted(map(str, caught.value.problems))
    assert f"there is no file {tmp_path}/none.yaml: docs/cameras.md says how to make it" in first
    assert "camera.rate" in second


def test_an_address_is_no_calibration_and_is_not_shown(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[camera]\ncalibration = "https://me:SECRET@cam/1"\n')
    with pytest.raises(ConfigError, match="give a path on this computer") as caught:
        load_config(path)
    assert "SECRET" not in str(caught.value)


def test_what_is_printed_loads_as_the_same_and_a_recording_has_the_rectified_view(tmp_path: Path) -> None:
    config = _loaded(tmp_path, more=MOUNT)
    printed = format_config(config)
    (tmp_path / "again.toml").write_text(printed)
    assert replace(load_config(tmp_path / "again.toml"), vehicle=config.vehicle) == config
    recorded = recorded_config(printed)
    assert (recorded.calibration, recorded.camera.calibration) == (None, None)
    assert (recorded.camera.view, recorded.mount.aspect) == (config.camera.view, config.mount.aspect)


def test_a_calibration_travels_to_the_vision_process(tmp_path: Path) -> None:
    import pickle

    config = _loaded(tmp_path)
    again = pickle.loads(pickle.dumps(config))
    assert isinstance(again.calibration, LensCalibration)
    assert again == config
