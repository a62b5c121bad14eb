"""Which frames are clean, what is a thing, and that the bench says why it is skipped."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.evaluation.datasets import LabelledFrame
from bench.perception import __main__ as bench
from bench.perception.frames import LabelledSet, read_frames
from bench.perception.stops import frames_with

NAMES = ("dirt", "sky", "rock bed", "bush", "grass", "obstacle", "person")


def frame(number: int, *patches: tuple[int, float]) -> LabelledFrame:
    """Make a frame of dirt with a patch of other labels, each on a share of the ROI's rows."""
    labels = np.zeros((100, 90), dtype=np.uint8)
    top = 60
    for label, part in patches:
        rows = round(35 * part)
        labels[top : top + rows, 30:60] = label
        top += rows
    return LabelledFrame(number, str(number), np.zeros((100, 90, 3), dtype=np.uint8), labels)


def place(*frames: LabelledFrame) -> LabelledSet:
    return LabelledSet("place", frames, NAMES, 255)


def test_a_frame_is_clean_when_all_of_its_region_is_drivable() -> None:
    frames = place(
        frame(0), frame(1, (4, 0.5)), frame(2, (3, 0.03)), frame(3, (255, 0.03)), frame(4, (5, 1.0))
    )
    assert [one.number for one in frames.clean] == [0, 1]


def test_things_and_plants_are_counted_by_their_share_of_the_region() -> None:
    frames = place(frame(0, (2, 0.2)), frame(1, (6, 0.03)), frame(2, (3, 0.2)), frame(3, (5, 0.5)), frame(4))
    assert [NAMES[label] for label in frames.things] == ["rock bed", "person"]
    assert [index for _, index in frames_with([frames], "things")] == [0, 1]
    assert [index for _, index in frames_with([frames], "plants")] == [2]


def write(folder: Path, numbers: Sequence[int]) -> None:
    folder.mkdir(parents=True)
    (folder / "classes.json").write_text(json.dumps({"ignore": 255, "classes": list(NAMES)}))
    for number in numbers:
        earth = np.full((60, 90, 3), (90, 120 + number % 7, 150), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number:04d}.jpg"), earth)
        cv2.imwrite(str(folder / f"{number:04d}.png"), np.zeros((60, 90), dtype=np.uint8))


def test_blocks_are_held_out_without_the_last_quarter_of_any_block(tmp_path: Path) -> None:
    write(tmp_path / "trail", [0, 74, 75, 200, 274, 299, 400, 480])
    write(tmp_path / "abroad/there", [5])
    found = read_frames(tmp_path, (2, 4))
    assert [[one.number for one in drive.frames] for drive in found.home] == [[200, 274], [400]]
    assert [one.number for one in found.trained.frames] == [0, 74]
    assert [one.name for one in found.abroad] == ["there"]


def test_without_the_labelled_frames_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["bench.perception", "--data", str(tmp_path)])
    assert bench.main() == 0
    assert "skipped" in json.loads(capsys.readouterr().out.splitlines()[-1])
