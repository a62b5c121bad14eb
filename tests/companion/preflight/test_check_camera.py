"""The camera's row: real folders of pictures, and what a companion that runs says of its camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.config import Config, load_config
from companion.preflight.here import check_camera
from companion.preflight.rules import Verdict

cv2 = pytest.importorskip("cv2")


def config(folder: Path, mount: str = "") -> Config:
    path = folder / "companion.toml"
    path.write_text(f'[vehicle]\nfile = ""\n[camera]\nsource = "folder:{folder}/pictures"\n{mount}')
    return load_config(str(path))


def pictures(folder: Path, width: int = 64, height: int = 36) -> None:
    (folder / "pictures").mkdir()
    cv2.imwrite(str(folder / "pictures/1.png"), np.zeros((height, width, 3), np.uint8))


def test_a_camera_that_is_not_there_fails_and_says_where_it_was_looked_for(tmp_path: Path) -> None:
    found = check_camera(config(tmp_path), None)
    assert found.verdict is Verdict.FAIL
    assert f"{tmp_path}/pictures cannot be read" in found.text
    assert "[camera] source" in found.text


def test_a_first_picture_passes(tmp_path: Path) -> None:
    pictures(tmp_path)
    found = check_camera(config(tmp_path), None)
    assert found.verdict is Verdict.PASS
    assert "64 x 36" in found.text


def test_pictures_that_are_all_torn_fail(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures/1.jpg").write_bytes(b"torn")
    found = check_camera(config(tmp_path), None)
    assert found.verdict is Verdict.FAIL
    assert "torn or no picture" in found.text


def test_a_picture_of_another_shape_than_the_mount_s_is_told_with_the_figure_to_set(tmp_path: Path) -> None:
    pictures(tmp_path)
    mount = "[mount]\nheight = 1.0\ntilt = 10.0\n"
    found = check_camera(config(tmp_path, mount), None)
    assert found.verdict is Verdict.WARN
    assert "aspect is 1.333: set it to 1.778" in found.text
    assert check_camera(config(tmp_path, mount + "aspect = 1.778\n"), None).verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("said", "verdict", "text"),
    [
        ({"camera": {"state": "delivering", "reason": ""}}, Verdict.PASS, "delivering"),
        ({"camera": {"state": "failed", "reason": "no cable"}}, Verdict.FAIL, "no cable"),
        ({"camera": {"state": "ended", "reason": "the last picture"}}, Verdict.FAIL, "the last picture"),
        ({"camera": {"state": "connecting"}}, Verdict.WARN, "wait"),
        ({}, Verdict.WARN, "unknown"),
    ],
)
def test_a_running_companion_s_camera_is_left_to_it(
    tmp_path: Path, said: dict[str, Any], verdict: Verdict, text: str
) -> None:
    found = check_camera(config(tmp_path), said)
    assert (found.verdict, text in found.text) == (verdict, True)
