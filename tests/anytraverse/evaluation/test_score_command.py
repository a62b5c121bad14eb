"""`anytraverse score`, on drives with known scores."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.cli import main
from anytraverse.release import to_install

MakeDrive = Callable[..., Path]
Out = pytest.CaptureFixture[str]

WORDS = "dirt: 1; grass: 1; bush: -1"
DIRT, GRASS, BUSH, DRUM, STRANGE = 40, 90, 140, 190, 250


def scored(capsys: Out, folder: Path, *more: str, words: str = WORDS) -> dict[str, Any]:
    """The JSON on the last line."""
    command = ["score", str(folder), "--perceiver", "grey", "--prompts", words]
    assert main([*command, "--drivable", "dirt path,grass", *more]) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return figures


def refused(capsys: Out, folder: Path, *more: str, words: str = WORDS, drivable: str = "grass") -> str:
    """The one line that says why."""
    command = ["score", str(folder), "--perceiver", "grey", "--prompts", words, "--drivable", drivable]
    assert main([*command, *more]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err.splitlines()[-1]


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """Frame 1 is seen as it is labelled; in 2 a bush is taken for grass, and a quarter is unlabelled."""
    return make_drive(
        {
            1: ([[DIRT, DIRT, BUSH, BUSH]], [[0, 0, 2, 2]]),
            2: ([[DIRT, GRASS, GRASS, GRASS]], [[0, 1, 2, 255]]),
        }
    )


pytestmark = pytest.mark.usefixtures("grey")


def test_iou_is_pooled_over_pixels_and_averaged_over_pictures(drive: Path, capsys: Out) -> None:
    figures = scored(capsys, drive)
    assert figures["iou_pooled"] == pytest.approx(4 / 5, abs=0.03)
    assert figures["iou_mean"] == pytest.approx((1 + 2 / 3) / 2, abs=0.03)
    assert figures["images"] == 2
    assert figures["torn"] == 0
    assert figures["ms_per_frame"] > 0
    assert figures["worst"][0]["frame"] == 2
    assert figures["drivable"] == ["dirt_path", "grass"]
    assert figures["model_id"] == "grey-1"


def test_maps_of_the_labels_size_are_scored_to_the_pixel(make_drive: MakeDrive, capsys: Out) -> None:
    folder = make_drive({1: ([[DIRT, BUSH]], [[0, 2]])})
    labels = np.full((32, 64), 2, dtype=np.uint8)
    labels[:, :24] = 0
    cv2.imwrite(str(folder / "0001.png"), labels)
    assert scored(capsys, folder)["iou_pooled"] == pytest.approx(24 / 32, abs=1e-4)


def test_a_weight_below_the_level_is_not_drivable_but_known_and_drivable(
    make_drive: MakeDrive, capsys: Out
) -> None:
    folder = make_drive({1: ([[DIRT, DIRT]], [[0, 0]])})
    figures = scored(capsys, folder, words="dirt: 0.4")
    assert (figures["iou_pooled"], figures["iou_known_pooled"]) == (0.0, 1.0)


def test_ground_without_a_word_is_not_drivable(make_drive: MakeDrive, capsys: Out) -> None:
    folder = make_drive({1: ([[DIRT, STRANGE]], [[0, 0]])})
    figures = scored(capsys, folder)
    assert figures["iou_pooled"] == pytest.approx(0.5, abs=0.08)
    assert figures["iou_known_pooled"] == pytest.approx(0.5, abs=0.08)


def test_words_are_ranked_on_their_classes_and_the_rest_is_said(drive: Path, capsys: Out) -> None:
    words = scored(capsys, drive, "--match", "dirt=dirt_path", words=WORDS + "; drum: -1")["words"]
    assert words["dirt"] == {
        "auroc": 1.0,
        "classes": ["dirt_path"],
        "how": "given",
        "pixels": 3 * 1024,
    }
    assert words["bush"]["auroc"] == pytest.approx((2 * 4 + 0.5 * 4) / (3 * 4), abs=0.03)
    assert words["drum"] == {"auroc": None, "classes": ["barrel"], "how": "name", "pixels": 0}
    nothing: dict[str, Any] = {"auroc": None, "classes": [], "how": "none", "pixels": 0}
    assert scored(capsys, drive)["words"]["dirt"] == nothing


def test_a_person_reads_a_table_above_the_json(drive: Path, capsys: Out) -> None:
    command = [
        "score",
        str(drive),
        "--perceiver",
        "grey",
        "--prompts",
        WORDS,
        "--drivable",
        "dirt path,grass",
    ]
    assert main(command) == 0
    said = capsys.readouterr()
    assert re.search(r"drive: 2 frames, grey-1, \d+\.\d ms a frame", said.out)
    assert re.search(r"traversability above 0\.5 +0\.[78]\d\d +0\.8\d\d\n", said.out)
    assert re.search(r"dirt +- +no label class matches: name one with --match", said.out)
    assert "worst frames  2 (0.6" in said.out
    assert "2/2 frames" in said.err
    json.loads(said.out.splitlines()[-1])
    assert main([*command, "--json"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_a_held_out_drive_is_scored_alone(drive: Path, capsys: Out) -> None:
    figures = scored(capsys, drive, "--from", "1", "--to", "1")
    assert (figures["images"], figures["iou_pooled"]) == (1, 1.0)
    assert (figures["from"], figures["to"], figures["every"]) == (1, 1, 1)
    assert scored(capsys, drive, "--every", "2")["images"] == 1


def test_a_torn_picture_is_named_counted_and_left_out(drive: Path, capsys: Out) -> None:
    (drive / "0002.jpg").write_bytes(b"\xff\xd8 torn")
    command = ["score", str(drive), "--perceiver", "grey", "--prompts", WORDS, "--drivable", "dirt path"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert "0002.jpg: torn, or not a picture, skipped" in said.err
    assert "1 frames (1 torn)" in said.out
    figures = json.loads(said.out.splitlines()[-1])
    assert (figures["images"], figures["torn"]) == (1, 1)


def test_a_picture_with_nothing_drivable_in_it_has_no_iou_of_its_own(
    make_drive: MakeDrive, capsys: Out
) -> None:
    folder = make_drive({1: ([[DIRT]], [[0]]), 2: ([[BUSH]], [[2]])})
    figures = scored(capsys, folder)
    assert (figures["images"], figures["iou_mean"], figures["iou_pooled"]) == (2, 1.0, 1.0)


def test_a_folder_without_anything_to_score_says_so(make_drive: MakeDrive, capsys: Out) -> None:
    folder = make_drive({1: ([[BUSH]], [[2]])})
    assert "no pixel is labelled drivable or found so" in refused(capsys, folder)


@pytest.mark.parametrize(
    ("words", "drivable", "more", "why"),
    [
        ("moss: 1", "grass", (), '"moss" is not a word it knows'),
        ("", "grass", (), "no word is asked"),
        ("dirt: 1; soil: -1", "grass", (), "contradicts"),
        (WORDS, "lawn", (), '"lawn" is not a class'),
        (WORDS, ",", (), "no class is named"),
        (WORDS, "grass", ("--match", "drum=barrel"), '"drum" is matched but not asked'),
        (WORDS, "grass", ("--every", "0"), "every 0 is no step"),
        (WORDS, "grass", ("--from", "9"), "numbers go from 1 to 2"),
        (WORDS, "grass", ("--threads", "-1"), "threads is -1"),
    ],
)
def test_what_cannot_be_scored_is_refused_in_one_line(
    drive: Path, capsys: Out, words: str, drivable: str, more: tuple[str, ...], why: str
) -> None:
    line = refused(capsys, drive, *more, words=words, drivable=drivable)
    assert line.startswith("anytraverse score: ")
    assert why in line


def test_a_perceiver_that_gives_nonsense_is_named_with_the_frame(
    drive: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grey, "broken", True)
    assert "0001.jpg: attention maps are not finite" in refused(capsys, drive)


def test_a_missing_opencv_is_told_with_what_to_install(capsys: Out, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith("anytraverse.evaluation.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert main(["score", "somewhere"]) == 2
    assert capsys.readouterr().err == f"anytraverse score: needs cv2: {to_install('rover')}\n"


@pytest.mark.slow
def test_the_built_in_perceiver_finds_trails_on_real_frames(capsys: Out) -> None:
    folder = Path(__file__).parents[3].parent / "shared" / "data" / "trail"
    if not folder.is_dir():
        pytest.skip("the development frames ../shared/data are absent")
    words = "trail: 1; dirt: 1; gravel: 1; grass: 1; bush: -1; tree: -1; sky: -1"
    command = ["score", str(folder), "--prompts", words, "--drivable", "smooth_trail,rough_trail,grass"]
    assert main([*command, "--every", "60"]) == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["images"] == 12
    assert figures["iou_pooled"] > 0.5
    assert figures["words"]["sky"]["auroc"] > 0.9
