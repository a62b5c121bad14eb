"""Cameras of the kernel: what is said where there is none."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from companion.cameras import CameraError, open_camera
from companion.cameras.v4l2 import DeviceError, query


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("/dev/video-none", "is not there: plug it in"),
        ("/dev/null", "is no camera"),
        ("/dev", "cannot be opened"),
    ],
)
def test_what_is_no_camera_says_what_to_do(path: str, why: str) -> None:
    with pytest.raises(CameraError, match=why):
        open_camera(f"v4l2:{path}")


def test_a_number_is_a_device_of_the_kernel() -> None:
    with pytest.raises(CameraError, match="/dev/video4294967295 is not there"):
        open_camera("v4l2:4294967295")


def test_a_device_that_may_not_be_opened_names_the_group(tmp_path: Path) -> None:
    device = tmp_path / "video0"
    device.touch()
    device.chmod(0)
    assert stat.S_IMODE(device.stat().st_mode) == 0
    if os.geteuid() == 0:
        pytest.skip("root may open everything")
    with pytest.raises(DeviceError, match="usermod -aG video"):
        query(str(device))
