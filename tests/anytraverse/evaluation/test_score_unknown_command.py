"""`anytraverse score-unknown`, on drives with known scores."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.cli import main

MakeDrive = Callable[..., Path]
Out = pytest.CaptureFixture[str]

WORDS = "dirt: 1; grass: 1; bush: -1"
DIRT, GRASS, BUSH, DRUM, STRANGE = 40, 90, 140, 190, 250

pytestmark = pytest.mark.usefixtures("grey")


def command(folder: Path, *more: str, words: str = WORDS, unknown: str = "barrel") -> list[str]:
    known = ["--prompts", words, "--drivable", "dirt path,grass"]
    return ["score-unknown", str(folder), "--perceiver", "grey", *known, "--unknown", unknown, *more]


def scored(capsys: Out, arguments: list[str]) -> dict[str, Any]:
    """The JSON on the last line."""
    assert main(arguments) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return figures


def refused(capsys: Out, arguments: list[str]) -> str:
    """The one line that says why."""
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err.splitlines()[-1]


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """In frame 1 a drum, unlike any word; in 2 one like grass, and ground that nothing explains."""
    return make_drive(
        {
            1: ([[DIRT, DIRT, DIRT], [DIRT, DIRT, DRUM]], [[0, 0, 0], [0, 0, 3]]),
            2: ([[STRANGE, GRASS], [GRASS, GRASS]], [[0, 255], [3, 1]]),
        }
    )


def test_a_thing_without_a_word_stands_out_from_the_ground(drive: Path, capsys: Out) -> None:
    figures = scored(capsys, command(drive, "--to", "1"))
    assert figures["auroc"] > 0.95
    assert figures["drivable_above_half"] < 0.02
    assert figures["unknown_above_half"] > 0.8
    assert figures["pixels"] == {"unknown": 1024, "drivable": 5 * 1024}
    assert figures["images"] == 1
    assert figures["unknown"]["barrel"]["pixels"] == 1024


def test_a_thing_that_looks_like_ground_and_ground_that_nothing_explains_are_counted(
    drive: Path, capsys: Out
) -> None:
    figures = scored(capsys, command(drive, "--from", "2", "--to", "2"))
    assert figures["auroc"] == pytest.approx(0.25, abs=0.2)
    assert figures["drivable_above_half"] == pytest.approx(0.5, abs=0.1)
    assert figures["unknown_above_half"] < 0.1


def test_classes_are_scored_each_and_together(drive: Path, capsys: Out) -> None:
    figures = scored(capsys, command(drive, words="dirt: 1; grass: 1", unknown="barrel,bush"))
    assert figures["unknown"]["bush"] == {"auroc": None, "pixels": 0}
    assert figures["unknown"]["barrel"]["auroc"] == figures["auroc"]
    assert main(command(drive, words="dirt: 1; grass: 1", unknown="barrel,bush")) == 0
    said = capsys.readouterr().out
    assert "together" in said
    assert "of drivable pixels" in said
    json.loads(said.splitlines()[-1])
    assert main(command(drive, "--json")) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("word", ["barrel", "drum"])
def test_a_word_for_what_shall_be_unknown_is_refused_by_name_and_by_meaning(
    drive: Path, capsys: Out, word: str
) -> None:
    line = refused(capsys, command(drive, words=f"{WORDS}; {word}: -1"))
    assert line.startswith(f'anytraverse score-unknown: "{word}" asks for "barrel", which shall be unknown')


def test_a_class_cannot_be_unknown_and_drivable(drive: Path, capsys: Out) -> None:
    line = refused(capsys, command(drive, words="dirt: 1", unknown="grass,barrel"))
    assert '"grass" is both unknown and drivable' in line


def test_a_folder_without_such_pixels_says_so(make_drive: MakeDrive, capsys: Out) -> None:
    ground = make_drive({1: ([[DIRT, BUSH]], [[0, 2]])}, name="ground")
    assert "no pixel is labelled barrel" in refused(capsys, command(ground))
    things = make_drive({1: ([[DRUM, BUSH]], [[3, 2]])}, name="things")
    assert "no pixel is labelled dirt_path or grass" in refused(capsys, command(things))


def test_a_folder_without_labels_says_so(make_drive: MakeDrive, capsys: Out) -> None:
    folder = make_drive({1: ([[DIRT, DRUM]], [[255, 255]])})
    assert "no pixel is labelled" in refused(capsys, command(folder))


def test_a_torn_picture_is_left_out(drive: Path, capsys: Out) -> None:
    (drive / "0002.png").write_bytes(b"")
    figures = scored(capsys, command(drive))
    assert (figures["images"], figures["torn"]) == (1, 1)


def test_a_perceiver_that_gives_nonsense_is_named_with_the_frame(
    drive: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grey, "broken", True)
    assert "0001.jpg: attention maps are not finite" in refused(capsys, command(drive))


def test_obstacles_on_real_frames_are_less_known_than_the_ground(capsys: Out) -> None:
    folder = Path(__file__).parents[3].parent / "shared" / "data" / "trail"
    if not folder.is_dir():
        pytest.skip("the development frames ../shared/data are absent")
    words = "trail: 1; grass: 1; bush: -1; tree: -1; sky: -1"
    known = ["--prompts", words, "--drivable", "smooth_trail,rough_trail,grass"]
    figures = scored(capsys, ["score-unknown", str(folder), *known, "--unknown", "obstacle", "--every", "30"])
    assert figures["auroc"] > 0.5
    assert figures["pixels"]["unknown"] > 1000
