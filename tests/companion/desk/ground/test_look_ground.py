"""`companion look-ground`: what it draws, what it prints, what it refuses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.look import read_picture
from companion.cli import main
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World

MOUNT = """
[vehicle]
file = ""
[camera]
view = 75.0
[mount]
height = 1.0
tilt = 7.0
front = 0.6
"""


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    world = World(0)
    image, _ = PinholeCamera(world).render(world.trail.pose(20.0), 0.0)
    cv2.imwrite(str(tmp_path / "field.png"), image[..., ::-1])
    return tmp_path / "field.png"


def look(picture: Path, config: str) -> int:
    """Type the command."""
    file = picture.with_name("companion.toml")
    file.write_text(config)
    return main(
        ["look-ground", str(picture), "--config", str(file), "--out", str(picture.with_name("out.png"))]
    )


def test_it_says_where_horizon_region_and_stop_are(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = MOUNT + "[roi]\ntop = 0.5\n[stopping]\nspeed = 1.0\n"
    assert look(picture, config) == 0
    told = capsys.readouterr().out
    assert "height 1 m, tilt 7 degrees, view 75 degrees, front 0.6 m ahead of the lens" in told
    assert "row 0.39 of the height, 94 of 240 pixels" in told
    assert "the lowest row shows the ground 0.7 m ahead" in told
    assert "upper side 7.5 m ahead (beyond 6 m no distance is reliable), lower side 0.9 m ahead" in told
    assert "stops     in 4.2 m at 1 m/s" in told
    assert "WARNING" not in told
    assert look(picture, config.replace("[roi]", "width = 0.6\n[roi]")) == 0
    told = capsys.readouterr().out
    assert "width     0.6 m" in told
    assert "region    0.8 to 5.4 m ahead, 1.2 m wide" in told


def test_the_picture_has_the_lines_where_the_mount_puts_them(picture: Path) -> None:
    assert look(picture, MOUNT + "[stopping]\nspeed = 0.5\n") == 0
    before, drawn = (read_picture(str(picture.with_name(name))) for name in ("field.png", "out.png"))
    assert drawn.shape == (720, 960, 3)
    changed = np.abs(drawn.astype(int) - cv2.resize(before, (960, 720), interpolation=cv2.INTER_CUBIC)) > 0
    horizon = round(0.3929 * 719)
    assert changed[horizon].any(axis=1).mean() > 0.95
    assert not changed[: horizon - 25].any()


def test_without_a_mount_it_says_what_to_set(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert look(picture, '[vehicle]\nfile = ""\n') == 2
    told = capsys.readouterr().err
    assert "set [mount] height (m of the lens above the ground) and tilt" in told
    assert not picture.with_name("out.png").exists()


def test_a_view_that_is_no_pinholes_is_refused(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert look(picture, MOUNT.replace("75.0", "150.0")) == 2
    assert "[camera] view is 150 degrees" in capsys.readouterr().err


def test_what_is_not_set_is_named_and_drawn_as_assumed(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert look(picture, MOUNT) == 0
    told = capsys.readouterr().out
    assert "not known, 1 m is drawn: set [mount] width" in told
    assert "stops     set [stopping] speed" in told


def test_a_picture_of_another_shape_is_warned_of(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert look(picture, MOUNT + "aspect = 1.778\n") == 0
    assert "the picture is 320 x 240, and [mount] aspect is 1.778" in capsys.readouterr().out


def test_a_folder_of_pictures_shows_its_first(picture: Path) -> None:
    folder = picture.with_name("drive")
    folder.mkdir()
    picture.rename(folder / picture.name)
    (folder.parent / "companion.toml").write_text(MOUNT)
    out = folder.parent / "out.png"
    arguments = ["--config", str(folder.parent / "companion.toml"), "--out", str(out)]
    assert main(["look-ground", str(folder), *arguments]) == 0
    assert out.is_file()


@pytest.mark.slow
@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", b"no picture"])
def test_what_is_no_picture_ends_with_2(
    picture: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    picture.write_bytes(content)
    assert look(picture, MOUNT) == 2
    assert "not a picture that can be read" in capsys.readouterr().err


def test_a_picture_that_is_not_there_ends_with_2(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture.unlink()
    assert look(picture, MOUNT) == 2
    assert "field.png" in capsys.readouterr().err
