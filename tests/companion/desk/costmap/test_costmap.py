"""`companion costmap`: a recorded drive's grid as a picture, as arrays, and as a map for Nav2."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.writer import Writer

from anytraverse.grid import CELL, SIDE
from companion.cli import main
from companion.sim.field.things import World
from tests.companion.desk.ground.simulated import CONFIG, START, record

WORDS = {"grass": 1.0, "dirt path": 1.0, "gravel": 1.0, "sky": -0.5, "bush": -1.0, "tree": -1.0}
MOUNT = "[mount]\nheight = 1.0\ntilt = 7.0\nfront = 0.3\nwidth = 0.6\n"
Out = pytest.CaptureFixture[str]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "companion.toml").write_text(CONFIG + MOUNT)
    return tmp_path / "companion.toml"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    record(path, 0, frames=12, words=WORDS, posed=True)
    return path


def costmap(drive: Path, config: Path, *more: str) -> int:
    """Type the command."""
    out = str(config.parent / "out")
    return main(["costmap", str(drive), "--config", str(config), "--out", out, *more])


@pytest.mark.slow
def test_a_recorded_drive_becomes_a_map_of_the_ground_around_it(
    drive: Path, config: Path, capsys: Out
) -> None:
    assert costmap(drive, config) == 0
    assert "12 frames, 5.5 s: " in capsys.readouterr().out
    layers = np.load(config.parent / "out" / "costmap.npz")
    assert layers["known"].shape == (SIDE, SIDE)
    assert float(layers["resolution"]) == CELL
    assert layers["drivable"][layers["known"]].mean() > 0.9
    x, y, _ = layers["pose"]
    driven = World(0).trail.pose(START + 0.8 * 5.5)
    assert (x, y) == pytest.approx((driven.x, driven.y), abs=0.01)
    assert np.allclose(layers["origin"] + SIDE * CELL / 2, (x, y), atol=CELL)
    picture = cv2.imread(str(config.parent / "out" / "costmap.png"))
    assert picture is not None
    assert picture.shape == (300, 240, 3)
    assert (102, 197, 171) in {tuple(map(int, one)) for one in picture[..., ::-1].reshape(-1, 3)}


def test_nav2_reads_the_map_as_the_grid_knows_it(drive: Path, config: Path) -> None:
    """The rules are those of nav2_map_server's loader for mode trinary."""
    assert costmap(drive, config) == 0
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


def test_at_a_moment_only_what_was_seen_until_then_is_known(drive: Path, config: Path, capsys: Out) -> None:
    assert costmap(drive, config, "--at", "1") == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("3 frames, 1.0 s: ")


def test_without_poses_it_says_what_is_missing(tmp_path: Path, config: Path, capsys: Out) -> None:
    record(tmp_path / "drive.mcap", 0, frames=3, words=WORDS)
    assert costmap(tmp_path / "drive.mcap", config) == 1
    assert "it is not known how the vehicle drove: no frame has a pose" in capsys.readouterr().out
    assert not (config.parent / "out").exists()


def test_what_cannot_be_judged_again_is_told(tmp_path: Path, config: Path, capsys: Out) -> None:
    record(tmp_path / "drive.mcap", 0, frames=3, posed=True)
    assert costmap(tmp_path / "drive.mcap", config) == 1
    told = capsys.readouterr().out
    assert "not in it, without words in the recording: 3 frames" in told
    assert "nothing is known 1.0 s after the first frame" in told


def test_without_a_mount_it_says_what_to_set(drive: Path, tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "companion.toml").write_text(CONFIG)
    assert costmap(drive, tmp_path / "companion.toml") == 2
    assert "set [mount] height" in capsys.readouterr().err


def test_pictures_and_videos_are_refused(tmp_path: Path, config: Path, capsys: Out) -> None:
    (tmp_path / "drive.mp4").write_bytes(b"")
    assert costmap(tmp_path / "drive.mp4", config) == 2
    assert "is no recording" in capsys.readouterr().err


def test_a_file_of_another_kind_is_no_recording(tmp_path: Path, config: Path, capsys: Out) -> None:
    with (tmp_path / "empty.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    assert costmap(tmp_path / "empty.mcap", config) == 2
    assert "no frames of a recording" in capsys.readouterr().err
