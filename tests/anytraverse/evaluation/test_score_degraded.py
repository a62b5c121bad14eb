"""`anytraverse score --degrade`, on a drive with known scores."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.cli import main
from anytraverse.evaluation.degrade import DEGRADATIONS

Out = pytest.CaptureFixture[str]

DIRT, GRASS, BUSH = 40, 90, 140
COLUMNS = ("iou_pooled", "iou_known_pooled", "uncertainty_mean", "drivable_above_half")

pytestmark = pytest.mark.usefixtures("grey")


@pytest.fixture
def drive(make_drive: Callable[..., Path]) -> Path:
    return make_drive(
        {
            1: ([[DIRT, DIRT, BUSH, BUSH]], [[0, 0, 2, 2]]),
            2: ([[DIRT, GRASS, GRASS, GRASS]], [[0, 1, 2, 255]]),
        }
    )


def run(folder: Path, *more: str) -> int:
    words = ["--perceiver", "grey", "--prompts", "dirt: 1; grass: 1; bush: -1"]
    return main(["score", str(folder), *words, "--drivable", "dirt path,grass", *more])


def scored(capsys: Out, folder: Path, *more: str) -> dict[str, Any]:
    assert run(folder, *more) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return figures


def refused(capsys: Out, folder: Path, *more: str) -> str:
    assert run(folder, *more) == 2
    said = capsys.readouterr()
    assert said.out == ""
    return said.err.splitlines()[-1]


def test_as_filmed_is_what_the_command_scores_without_degradations(drive: Path, capsys: Out) -> None:
    plain, figures = scored(capsys, drive), scored(capsys, drive, "--degrade", "fog")
    assert list(figures["degraded"]) == ["as filmed", "fog"]
    for key in COLUMNS[:2]:
        assert figures["degraded"]["as filmed"][key] == plain[key]
    assert (figures["images"], figures["torn"], figures["model_id"]) == (2, 0, "grey-1")
    assert figures["ms_per_frame"] > 0


def test_the_uncertainty_is_that_of_labelled_drivable_ground(drive: Path, capsys: Out) -> None:
    rows = scored(capsys, drive, "--degrade", "fog,half-light")["degraded"]
    assert rows["as filmed"]["uncertainty_mean"] == pytest.approx(0.0, abs=0.03)
    assert rows["as filmed"]["drivable_above_half"] == 0.0
    assert rows["fog"]["uncertainty_mean"] > 0.5
    assert rows["fog"]["drivable_above_half"] > 0.5
    assert rows["half-light"]["iou_pooled"] < rows["as filmed"]["iou_pooled"]


def test_all_degradations_are_scored_and_twice_alike(drive: Path, capsys: Out) -> None:
    first = scored(capsys, drive, "--degrade", "all")["degraded"]
    assert list(first) == ["as filmed", *DEGRADATIONS]
    assert scored(capsys, drive, "--degrade", "all")["degraded"] == first


def test_names_are_taken_in_their_order_and_once(drive: Path, capsys: Out) -> None:
    rows = scored(capsys, drive, "--degrade", " Warm, jpeg,warm")["degraded"]
    assert list(rows) == ["as filmed", "warm", "jpeg"]


def test_table_and_json_agree_and_the_table_has_the_differences(drive: Path, capsys: Out) -> None:
    assert run(drive, "--degrade", "fog,magenta") == 0
    *table, last = capsys.readouterr().out.splitlines()
    rows = json.loads(last)["degraded"]
    shown = {line[:18].strip(): line[18:].split() for line in table[2:]}
    assert shown.keys() == rows.keys()
    for name, row in rows.items():
        values = [float(cell) for cell in shown[name]]
        if name == "as filmed":
            assert values == pytest.approx([row[key] for key in COLUMNS], abs=6e-4)
        else:
            assert values[::2] == pytest.approx([row[key] for key in COLUMNS], abs=6e-4)
            differences = [row[key] - rows["as filmed"][key] for key in COLUMNS]
            assert values[1::2] == pytest.approx(differences, abs=6e-4)


def test_json_alone_is_printed_where_it_is_asked_for(drive: Path, capsys: Out) -> None:
    assert run(drive, "--degrade", "jpeg", "--json") == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("names", ["mist", "fog,mist", "", "all,fog"])
def test_a_name_that_no_degradation_has_is_refused_with_those_that_there_are(
    drive: Path, capsys: Out, names: str
) -> None:
    said = refused(capsys, drive, "--degrade", names)
    assert "no degradation is called" in said
    assert "motion-blur" in said


def test_match_and_degrade_are_refused_together(drive: Path, capsys: Out) -> None:
    with pytest.raises(SystemExit) as ended:
        run(drive, "--degrade", "fog", "--match", "dirt=dirt_path")
    assert ended.value.code == 2
    assert "not allowed with" in capsys.readouterr().err


def test_frames_without_drivable_ground_are_refused(make_drive: Callable[..., Path], capsys: Out) -> None:
    folder = make_drive({1: ([[BUSH, BUSH]], [[2, 2]])})
    assert "no pixel is labelled" in refused(capsys, folder, "--degrade", "fog")
