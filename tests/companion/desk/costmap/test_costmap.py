"""`companion costmap`: a recorded drive's grid as a picture, as arrays, and as a map for Nav2."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.writer import Writer

from anytraverse.grid import CELL, SIDE
from companion.cli import main
from companion.desk.costmap.driven_poses import driven_poses
from companion.desk.ground.driven_pairs import DrivenMotion
from tests.companion.desk.ground.simulated import CONFIG, record

WORDS = {"grass": 1.0, "dirt path": 1.0, "gravel": 1.0, "sky": -0.5, "bush": -1.0, "tree": -1.0}
MOUNT = "[mount]\nheight = 1.0\ntilt = 7.0\nfront = 0.3\nwidth = 0.6\n"
Out = pytest.CaptureFixture[str]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "companion.toml").write_text(CONFIG + MOUNT)
    return tmp_path / "companion.toml"


@pytest.fixture(scope="module")
def derived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "derived.mcap"
    record(path, 0, frames=12, speed=0.8, words=WORDS)
    return path


def costmap(drive: Path, config: Path, *more: str) -> int:
    """Type the command."""
    out = str(config.parent / "out")
    return main(["costmap", str(drive), "--config", str(config), "--out", out, *more])


def test_a_recorded_drive_becomes_a_map_of_the_ground_around_it(
    derived: Path, config: Path, capsys: Out
) -> None:
    assert costmap(derived, config) == 0
    assert "12 of 12 poses are derived from the reported speed and heading" in capsys.readouterr().out
    layers = np.load(config.parent / "out" / "costmap.npz")
    assert layers["known"].shape == (SIDE, SIDE)
    assert float(layers["resolution"]) == CELL
    assert layers["drivable"][layers["known"]].mean() > 0.9
    x, y, _ = layers["pose"]
    assert np.hypot(x, y) == pytest.approx(0.8 * 5.5, abs=0.1)
    assert np.allclose(layers["origin"] + SIDE * CELL / 2, (x, y), atol=CELL)
    picture = cv2.imread(str(config.parent / "out" / "costmap.png"))
    assert picture is not None
    assert picture.shape == (300, 240, 3)
    assert (102, 197, 171) in {tuple(map(int, one)) for one in picture[..., ::-1].reshape(-1, 3)}


def test_nav2_reads_the_map_as_the_grid_knows_it(derived: Path, config: Path) -> None:
    """The rules are those of nav2_map_server's loader for mode trinary."""
    assert costmap(derived, config) == 0
    out = config.parent / "out"
    told = dict(line.split(": ", 1) for line in (out / "costmap.yaml").read_text().splitlines())
    assert told["mode"] == "trinary"
    picture = cv2.imread(str(out / told["image"]), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    occupancy = (255 - picture.astype(float)) / 255
    layers = np.load(out / "costmap.npz")
    assert ((occupancy < float(told["free_thresh"]))[::-1] == layers["drivable"]).all()
    blocked = layers["known"] & ~layers["drivable"]
    assert ((occupancy > float(told["occupied_thresh"]))[::-1] == blocked).all()
    x, y, yaw = json.loads(told["origin"])
    assert np.allclose((x, y), layers["origin"], atol=1e-3)
    assert yaw == 0.0


def test_at_a_moment_only_what_was_seen_until_then_is_known(derived: Path, config: Path, capsys: Out) -> None:
    assert costmap(derived, config, "--at", "1") == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("3 frames, 1.0 s: ")


def test_recorded_poses_come_before_what_can_be_derived(tmp_path: Path, config: Path, capsys: Out) -> None:
    record(tmp_path / "posed.mcap", 0, frames=4, speed=0.8, words=WORDS, posed=True)
    assert costmap(tmp_path / "posed.mcap", config) == 0
    assert "derived" not in capsys.readouterr().out


def test_without_the_speed_it_says_what_is_missing(tmp_path: Path, config: Path, capsys: Out) -> None:
    record(tmp_path / "drive.mcap", 0, frames=3, speed=None, words=WORDS)
    assert costmap(tmp_path / "drive.mcap", config) == 1
    assert "it is not known how the vehicle drove: no frame has a pose" in capsys.readouterr().out
    assert not (config.parent / "out").exists()


def test_what_cannot_be_judged_again_is_told(tmp_path: Path, config: Path, capsys: Out) -> None:
    record(tmp_path / "drive.mcap", 0, frames=3, speed=0.8)
    assert costmap(tmp_path / "drive.mcap", config) == 1
    told = capsys.readouterr().out
    assert "not in it, without words in the recording: 3 frames" in told
    assert "nothing is known 1.0 s after the first frame" in told


def test_without_a_mount_it_says_what_to_set(derived: Path, tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "companion.toml").write_text(CONFIG)
    assert costmap(derived, tmp_path / "companion.toml") == 2
    assert "set [mount] height" in capsys.readouterr().err


def test_pictures_and_videos_are_refused(tmp_path: Path, config: Path, capsys: Out) -> None:
    (tmp_path / "drive.mp4").write_bytes(b"")
    assert costmap(tmp_path / "drive.mp4", config) == 2
    assert "is no recording" in capsys.readouterr().err


def moving(times: Sequence[float], yaw: float) -> DrivenMotion:
    return DrivenMotion(
        [
            {"position_at": at, "speed": 2.0, "attitude_at": at, "attitude": [0.0, 0.0, yaw % 360]}
            for at in times
        ]
    )


def test_poses_follow_speed_and_heading_and_begin_anew_after_a_gap() -> None:
    times = [0.0, 0.5, 1.0, 1.5, 2.0, 5.0, 5.5, 6.0]
    seen = [{"captured_at": at} for at in (0.0, 1.0, 2.0, 3.0, 5.2, 6.0)]
    found = list(driven_poses(seen, moving(times, 90.0)))
    assert [pose is None for pose in found] == [False, False, False, True, False, False]
    assert found[2] == pytest.approx((0.0, -4.0, -90.0), abs=1e-9)
    assert next(driven_poses([{}, *seen], moving(times, 90.0))) is None


def test_a_file_of_another_kind_is_no_recording(tmp_path: Path, config: Path, capsys: Out) -> None:
    with (tmp_path / "empty.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    assert costmap(tmp_path / "empty.mcap", config) == 2
    assert "no frames of a recording" in capsys.readouterr().err
