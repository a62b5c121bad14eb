"""`anytraverse look`: one picture in, figures and a panel out, errors in one line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.cli import main
from anytraverse.look import read_picture

Out = pytest.CaptureFixture[str]


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A file with an orange thing on a dirt path through grass, in the ROI."""
    rng = np.random.default_rng(0)
    canvas = np.empty((120, 160, 3))
    canvas[:45] = (150, 185, 235)
    canvas[45:] = np.asarray((84, 116, 48)) * (1 + 0.13 * rng.standard_normal((75, 160, 1)))
    canvas[45:, 45:115] = np.asarray((148, 118, 84)) * (1 + 0.13 * rng.standard_normal((75, 70, 1)))
    canvas[70:100, 65:95] = (222, 118, 28)
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), canvas.clip(0, 255).astype(np.uint8)[..., ::-1])
    return path


def test_the_figures_stand_as_one_json_object_on_the_last_line(photo: Path, capsys: Out) -> None:
    assert main(["look", str(photo), "--prompts", "grass: 1; dirt path: 0.9; sky: -0.5", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["reasons"] == ["unknown_object"]
    assert figures["similarity"] is None
    assert figures["prompts"] == {"grass": 1.0, "dirt path": 0.9, "sky": -0.5}
    assert 0.0 <= figures["roi_traversability"] <= 1.0
    assert figures["roi_uncertainty"] > 0.1
    assert figures["worst_tile"]["uncertainty"] > 0.7
    left, top, right, bottom = figures["worst_tile"]["box"]
    assert 0.3 < (left + right) / 2 < 0.7  # on the drum, or on its rim
    assert 0.55 < (top + bottom) / 2 < 0.85
    assert figures["milliseconds"] > 0


def test_without_json_a_person_can_read_it(photo: Path, capsys: Out) -> None:
    assert main(["look", str(photo)]) == 0
    text = capsys.readouterr().out
    assert "photo.png: unknown object" in text
    assert "uncertainty" in text
    assert "trail: 1" in text
    assert "weak words" not in text


@pytest.mark.parametrize("perceiver", ["builtin", "builtin:lexicon"])
def test_words_that_are_guesses_are_told(photo: Path, capsys: Out, perceiver: str) -> None:
    assert main(["look", str(photo), "--perceiver", perceiver, "--prompts", "grass: 1; stone: -1"]) == 0
    assert "weak words   stone: guesses" in capsys.readouterr().out


def test_a_panel_is_written_only_where_asked(photo: Path, tmp_path: Path, capsys: Out) -> None:
    assert main(["look", str(photo)]) == 0
    assert sorted(tmp_path.iterdir()) == [photo]
    assert main(["look", str(photo), "--out", str(tmp_path / "panel.png"), "--json"]) == 0
    panel = cv2.imread(str(tmp_path / "panel.png"))
    assert panel is not None
    assert panel.shape[1] > 1000
    json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.jpg"], "no such file"),
        (["."], "is a directory"),
        (["notes.txt"], "not a picture"),
        (["empty.jpg"], "not a picture"),
        (["photo.png", "--prompts", "gnome: 1"], '"gnome" is not a word'),
        (["photo.png", "--prompts", "grass"], "no weight"),
        (["photo.png", "--prompts", "grass: 7"], "not in -1"),
        (["photo.png", "--perceiver", "oracle"], "no perceiver"),
        (["photo.png", "--out", "nowhere/panel.png"], "no such file"),
    ],
)
def test_what_cannot_be_used_gets_one_line_and_code_2(
    arguments: list[str], said: str, photo: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    monkeypatch.chdir(photo.parent)
    Path("notes.txt").write_text("no picture")
    Path("empty.jpg").touch()
    assert main(["look", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("anytraverse look: ")
    assert said in captured.err


def test_it_runs_as_a_command_of_its_own(photo: Path) -> None:
    command = [sys.executable, "-m", "anytraverse.cli", "look", str(photo), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "unknown_object" in done.stdout.splitlines()[-1]
    assert done.stderr == ""


@pytest.mark.slow
def test_real_frames_of_other_robots_are_judged(capsys: Out) -> None:
    folder = Path(__file__).parents[2].parent / "shared" / "data" / "frames"
    if not folder.is_dir():
        pytest.skip("the development frames ../shared/data are absent")
    for path in sorted(folder.glob("*.jpg")):
        assert main(["look", str(path), "--json"]) == 0
        figures = json.loads(capsys.readouterr().out.splitlines()[-1])
        assert 0.0 <= figures["roi_uncertainty"] <= 1.0
    path = folder / "whojo_15.jpg"
    assert read_picture(str(path)).shape == (540, 960, 3)
    assert main(["look", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["reasons"] == []
