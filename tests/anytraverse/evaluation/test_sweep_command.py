"""`anytraverse sweep`: sets of words side by side, and none judged twice."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.cli import main
from anytraverse.evaluation import sweep_command

MakeDrive = Callable[..., Path]
Out = pytest.CaptureFixture[str]

DIRT, GRASS, BUSH, DRUM = 40, 90, 140, 190
FULL, HALF, NONE = "dirt: 1; grass: 1; bush: -1", "dirt: 1; grass: 0.4; bush: -1", "dirt: 1; bush: -1"

pytestmark = pytest.mark.usefixtures("grey")


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """Dirt, grass, bush and a drum, in two frames."""
    return make_drive(dict.fromkeys((1, 2), ([[DIRT, GRASS, BUSH, DRUM]], [[0, 1, 2, 3]])))


def command(drive: Path, out: Path, *sets: str) -> list[str]:
    known = ["--drivable", "dirt path,grass", "--unknown", "barrel", "--out", str(out)]
    asked = [argument for words in sets for argument in ("--prompts", words)]
    return ["sweep", "--dataset", f"folder:{drive}", "--perceiver", "grey", *known, *asked]


def swept(capsys: Out, arguments: list[str]) -> dict[str, Any]:
    assert main(arguments) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return figures


def test_sets_of_words_are_compared_in_their_order(drive: Path, tmp_path: Path, capsys: Out) -> None:
    figures = swept(capsys, command(drive, tmp_path / "out", FULL, HALF, NONE))
    full, half, none = figures["rows"]
    assert [row["prompts"] for row in figures["rows"]] == [FULL, HALF, NONE]
    assert full["iou_mean"] == pytest.approx(1, abs=0.05)
    assert half["iou_mean"] == pytest.approx(0.5, abs=0.05)
    assert half["best_iou_mean"] == pytest.approx(1, abs=0.05)
    assert half["best_threshold"] < 0.4
    assert none["drivable_above_half"] > half["drivable_above_half"]
    assert (figures["images"], figures["unknown"], len(full["curve"])) == (2, ["barrel"], 19)


def test_the_classes_of_the_words_are_told_and_the_operators_own_win(
    drive: Path, tmp_path: Path, capsys: Out
) -> None:
    figures = swept(capsys, command(drive, tmp_path / "out", FULL, NONE))
    assert figures["matches"]["bush"] == {"classes": ["bush"], "how": "name"}
    assert figures["matches"]["dirt"] == {"classes": [], "how": "none"}
    asked = ["evaluate", *command(drive, tmp_path / "own", FULL)[1:], "--match", "dirt=dirt_path"]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert "dirt = dirt_path; grass = grass; bush = bush" in said
    assert json.loads(said.splitlines()[-1])["matches"]["dirt"]["how"] == "given"
    assert main([*asked[:-1], "rock=grass"]) == 2
    assert '"rock" is matched but not asked' in capsys.readouterr().err


def test_each_set_has_the_figures_of_evaluate(drive: Path, tmp_path: Path, capsys: Out) -> None:
    rows = swept(capsys, command(drive, tmp_path / "out", FULL, HALF))["rows"]
    for row in rows:
        asked = ["evaluate", *command(drive, tmp_path / "alone", row["prompts"])[1:]]
        alone = swept(capsys, asked)
        for key in ("iou_mean", "iou_authors", "iou_pooled", "auroc", "curve", "calls"):
            assert row[key] == alone[key]


def test_a_frame_is_encoded_once_for_all_sets_and_not_again(
    drive: Path, tmp_path: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded = 0
    encode = grey.encode

    def counted(self: Any, image: Any) -> Any:
        nonlocal encoded
        encoded += 1
        return encode(self, image)

    monkeypatch.setattr(grey, "encode", counted)
    first = swept(capsys, command(drive, tmp_path / "out", FULL, HALF))
    assert encoded == 2
    assert swept(capsys, command(drive, tmp_path / "out", FULL, HALF)) == first
    assert encoded == 2
    swept(capsys, command(drive, tmp_path / "out", HALF, NONE))
    assert encoded == 4


def test_what_is_written_says_the_same(drive: Path, tmp_path: Path, capsys: Out) -> None:
    out = tmp_path / "out"
    assert main(command(drive, out, FULL, HALF)) == 0
    said = capsys.readouterr().out
    figures = json.loads(said.splitlines()[-1])
    assert json.loads((out / "sweep.json").read_text()) == figures
    rows = list(csv.DictReader((out / "sweep.csv").open()))
    assert [row["prompts"] for row in rows] == [FULL, HALF]
    assert float(rows[1]["best_threshold"]) == figures["rows"][1]["best_threshold"]
    assert f"| {HALF} | {figures['rows'][1]['iou_mean']:.3f} |" in (out / "sweep.md").read_text()
    assert said.splitlines()[2].endswith(f"   {FULL}")


def test_a_class_that_any_set_names_is_not_unknown(drive: Path, tmp_path: Path, capsys: Out) -> None:
    assert main(command(drive, tmp_path / "out", FULL, FULL + "; drum: -1")) == 2
    assert '"drum" asks for "barrel", which shall be unknown' in capsys.readouterr().err


def test_sets_have_a_bound_and_at_least_one_is_asked(
    drive: Path, tmp_path: Path, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_command, "MOST_WORDS", 1)
    assert main(command(drive, tmp_path / "out", FULL, HALF)) == 2
    assert "2 sets of words: 1 at most can be compared" in capsys.readouterr().err
    assert main(command(drive, tmp_path / "out")) == 2
    assert "--prompts" in capsys.readouterr().err
