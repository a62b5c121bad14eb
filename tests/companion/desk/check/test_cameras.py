"""`companion cameras`: what it lists, and the pictures that it saves."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.cameras.v4l2 import Device, DeviceError
from companion.cli import main
from companion.desk.check import cameras


@pytest.fixture(autouse=True)
def _no_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "devices", lambda: iter(()))
    monkeypatch.setattr(cameras, "_RPICAM", ())
    monkeypatch.setattr(cameras, "_of_depthai", lambda: iter(()))


def _config(folder: Path, source: str, more: str = "") -> Path:
    path = folder / "companion.toml"
    path.write_text(f'[camera]\nsource = "{source}"\n{more}\n[vehicle]\nfile = ""\n')
    return path


def test_the_configured_camera_is_shown_with_its_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    cv2.imwrite(str(frames / "a.png"), np.full((48, 64, 3), (0, 0, 250), np.uint8))
    file = _config(tmp_path, f"folder:{frames}")
    assert main(["cameras", str(file), "--out", str(tmp_path / "out")]) == 0
    picture = cv2.imread(str(tmp_path / "out" / "camera-1.jpg"))
    assert picture is not None
    assert picture.shape == (48, 64, 3)
    assert picture[24, 32, 2] > 240
    assert picture[24, 32, 0] < 20
    assert "64 x 48" in capsys.readouterr().out


def test_no_camera_at_all_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cameras", str(tmp_path / "none.toml"), "--out", str(tmp_path)]) == 1
    assert "no camera is plugged in" in capsys.readouterr().out


def test_each_device_comes_with_its_formats_and_the_line_to_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [
        Device(str(tmp_path / "gone"), "A webcam", {"MJPG": [(640, 480), (1280, 720)]}),
        DeviceError("/dev/video7 may not be opened: join the group"),
    ]
    monkeypatch.setattr(cameras, "devices", lambda: iter(found))
    assert main(["cameras", str(tmp_path / "none.toml"), "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "A webcam: MJPG 640x480, 1280x720" in said
    assert f'source = "v4l2:{tmp_path / "gone"}"' in said
    assert "is not there" in said
    assert "/dev/video7 may not be opened: join the group" in said


def test_the_cameras_of_a_raspberry_pi_are_read_from_its_own_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "rpicam-vid"
    program.write_text(
        f"#!{sys.executable}\nimport os,sys\n"
        "if '--list-cameras' in sys.argv:\n"
        "    print('Available cameras\\n-----------------\\n0 : imx708 [4608x2592] (/base/soc/i2c0)')\n"
        "while '--list-cameras' not in sys.argv: os.write(1, bytes([128]) * (640 * 480 * 3 // 2))\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(cameras, "_RPICAM", ("rpicam-vid",))
    monkeypatch.setattr(cameras, "_SETTLES", 0.0)
    assert main(["cameras", str(tmp_path / "none.toml"), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "imx708" in said
    assert 'source = "pipe:rpicam-vid -t 0 -n --codec yuv420 --width 640 --height 480' in said
    assert "640 x 480" in said


def test_a_password_is_never_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = _config(tmp_path, "http://me:secret@127.0.0.1:1/x")
    assert main(["cameras", str(file), "--out", str(tmp_path)]) == 1
    assert main(["config", "check", str(file)]) == 0
    captured = capsys.readouterr()
    assert "http://127.0.0.1:1/..." in captured.out
    assert "secret" not in captured.out + captured.err
