"""`companion demo --camera folder:... --every` judges each frame in turn, and the same again."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from companion.cameras import CameraError
from companion.cli import main
from companion.sim.demo.every import judge_every
from companion.sim.demo.story import Story

FRAMES = 60


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A meadow, and a violet thing on it from frame 20 on; file 30 is torn."""
    folder = tmp_path_factory.mktemp("drive")
    random = np.random.default_rng(1)
    for number in range(1, FRAMES + 1):
        image = np.full((120, 160, 3), (60, 140, 90), dtype=np.uint8)
        image[:50] = (235, 190, 140)
        if number >= 20:
            image[60:110, 55:105] = (200, 30, 220)
        image = np.clip(image + random.integers(-12, 12, image.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{number:03d}.png"), image)
    (folder / "030.png").write_bytes(b"torn")
    return folder


def judged(drive: Path, out: Path) -> tuple[dict[str, Any], str]:
    out.mkdir()
    stream = io.StringIO()
    assert judge_every(f"folder:{drive}", out, Story(stream)) == 0
    told = json.loads(stream.getvalue().splitlines()[-1])
    told.pop("seconds")
    return told, (out / "frames.jsonl").read_text()


def test_no_frame_is_left_out_and_the_same_folder_gives_the_same_calls(drive: Path, tmp_path: Path) -> None:
    told, lines = judged(drive, tmp_path / "one")
    assert (told["frames"], told["torn"], told["drive_s"]) == (FRAMES - 1, 1, 5.9)
    rows = [json.loads(line) for line in lines.splitlines()]
    assert [row["file"] for row in rows] == [f"{n:03d}.png" for n in range(1, FRAMES + 1) if n != 30]
    assert [row["frame"] for row in rows] == [n for n in range(1, FRAMES + 1) if n != 30]
    by_frame = {row["frame"]: row for row in rows}
    assert [by_frame[number]["open"] for number in told["at_call"]] == list(range(1, told["calls"] + 1))
    assert told["calls"] >= 1
    assert told["not_ok"] == sum(not row["ok"] for row in rows)
    assert (told, lines) == judged(drive, tmp_path / "two")


def test_only_a_folder_can_be_judged_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(CameraError, match="give folder:PATH"):
        judge_every("video:drive.mp4", tmp_path, Story(io.StringIO()))
    assert main(["demo", "--every", "--out", str(tmp_path / "none")]) == 1
    assert "--every needs --camera folder:PATH" in capsys.readouterr().err
    assert main(["demo", "--every", "--camera", f"folder:{tmp_path}", "--out", str(tmp_path / "none")]) == 1
    assert "holds no picture" in capsys.readouterr().err
