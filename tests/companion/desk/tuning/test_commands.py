"""`anytraverse calls` and `companion tune`, as an engineer types them."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from anytraverse.cli import main as anytraverse
from companion.cli import main as companion
from companion.config import load_config

Out = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what was seen out of the home folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def asked(drive: Path, out: Path, *options: str, episode: str = "") -> list[str]:
    config = str(drive.parent / "companion.toml")
    where = episode or str(drive)
    return ["calls", "--episode", where, "--config", config, "--out", str(out), "--jobs", "1", *options]


def figures(capsys: Out) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return found


@pytest.mark.slow
def test_each_combination_has_its_calls_by_reason_and_half(drive: Path, tmp_path: Path, capsys: Out) -> None:
    grid = ["--scene", "0.7,0.97", "--roi", "0.02,0.5", "--tile", "off"]
    assert anytraverse(asked(drive, tmp_path, "--operator", "go", *grid)) == 0
    shown = capsys.readouterr().out
    last = json.loads(shown.splitlines()[-1])
    whole = json.loads((tmp_path / "calls.json").read_text())
    assert (last["frames"], len(last["each"]), last["operator"]) == (16, 4, "a go to every call")
    for row in whole["each"]:
        assert row["calls"] == row["first_half"] + row["second_half"] == len(row["at_call"])
        assert row["unknown_object"] == sum("unknown_object" in one for one in row["reasons"])
    strict, loose = whole["each"][2], whole["each"][1]
    assert (strict["scene"], strict["roi"]) == (0.97, 0.02)
    assert strict["calls"] > loose["calls"]
    with (tmp_path / "calls.csv").open() as file:
        assert [row["tile"] for row in csv.DictReader(file)] == ["off"] * 4
    page = (tmp_path / "calls.html").read_text()
    assert page.count('class="plot"') == 2  # one to choose from, and one of the chosen setting's calls
    assert [row["number"] for row in whole["each"]] == [0, 1, 2, 3]
    assert "times that it would be held" in page, "a go to every call says nothing of things"


@pytest.mark.slow
def test_the_calls_of_a_region_that_the_vehicle_does_not_fit_in_are_counted_and_no_frame_is_ok(
    drive: Path, tmp_path: Path, capsys: Out
) -> None:
    grid = ["--scene", "0.97", "--roi", "0.02", "--tile", "off", "--region", "0.46,0.6,0.54,0.95"]
    assert anytraverse(asked(drive, tmp_path, "--operator", "go", "--misfits", *grid)) == 0
    (row,) = figures(capsys)["each"]
    assert row["calls"] > 0
    assert row["not_ok"] == 16


@pytest.mark.slow
def test_the_labels_answer_where_there_are_some(drive: Path, tmp_path: Path, capsys: Out) -> None:
    grid = ["--scene", "0.97", "--roi", "0.02", "--tile", "0.3"]
    labelled = asked(drive, tmp_path, "--drivable", "gravel", *grid, episode=f"folder:{drive}")
    assert anytraverse(labelled) == 0
    found = figures(capsys)
    assert (found["operator"], found["things"]) == ("the labels", 1), "the crate; trees are a word's"
    assert found["each"][0]["noticed"] == 1
    assert json.loads((tmp_path / "calls.json").read_text())["each"][0]["calls"] > 0


def test_a_script_answers_as_somebody_did(drive: Path, tmp_path: Path, capsys: Out) -> None:
    script = tmp_path / "answers.txt"
    frames = sorted(drive.glob("*.jpg"))
    script.write_text("".join(f"{frame.name} = no such word at all: 1, go\n" for frame in frames))
    grid = ["--scene", "0.97", "--roi", "0.02", "--tile", "0.3", "--answers", str(script)]
    assert anytraverse(asked(drive, tmp_path, *grid)) == 0
    found = figures(capsys)
    assert found["operator"] == f"{len(frames)} answers that were given, and else a go"
    assert found["each"][0]["refused"] > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--operator", "answers"), "no answers were recorded"),
        (("--operator", "go", "--answers", "x"), "belongs to answers"),
        (("--scene", "high", "--operator", "go"), "--scene"),
        (("--region", "1,2,3", "--operator", "go"), "--region"),
        (("--region", "0.46,0.6,0.54,0.95", "--operator", "go"), "ROI 0.08 wide, vehicle 0.30: widen it"),
        (("--roi", "2", "--operator", "go"), "roi is 2.0"),
        (("--operator", "labels"), "--drivable"),
        ((), "give --drivable, of tree, gravel, crate; or"),
        (("--jobs", "-1", "--operator", "go"), "--jobs -1"),
        (("--jobs", "1000000", "--operator", "go"), "1 to 256"),
        (("--cache-size", "0", "--operator", "go"), "--cache-size"),
        (("--rate", "0", "--operator", "go"), "--rate"),
        (("--operator", "go", "--to", "3"), "whole drive"),
        (("--prompts", "grass"), "grass"),
        (("--config", "/nowhere.toml"), "nowhere"),
    ],
)
def test_what_cannot_be_asked_is_told_in_one_line(
    drive: Path, tmp_path: Path, capsys: Out, options: tuple[str, ...], told: str
) -> None:
    assert anytraverse(asked(drive, tmp_path, *options)) == 2
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error


def test_a_drive_that_is_not_there_is_told(drive: Path, tmp_path: Path, capsys: Out) -> None:
    assert anytraverse(asked(drive, tmp_path, episode=str(tmp_path / "none"))) == 2
    assert "none" in capsys.readouterr().err


@pytest.mark.slow
def test_a_drive_without_a_frame_that_can_be_read_is_told(drive: Path, tmp_path: Path, capsys: Out) -> None:
    torn = tmp_path / "torn"
    torn.mkdir()
    (torn / "1.jpg").write_bytes(b"torn")
    assert anytraverse(asked(drive, tmp_path / "out", "--operator", "go", episode=str(torn))) == 2
    assert "no frame that can be read" in capsys.readouterr().err
    assert companion(["tune", str(torn), "--config", str(drive.parent / "companion.toml")]) == 2
    assert "no frame that can be read" in capsys.readouterr().err


@pytest.mark.slow
def test_a_name_of_several_lines_cannot_change_the_proposal(drive: Path, tmp_path: Path) -> None:
    odd = tmp_path / "a\n[words]\nb\x07"
    odd.symlink_to(drive)
    config = ["--config", str(drive.parent / "companion.toml"), "--out", str(tmp_path / "out")]
    assert companion(["tune", str(odd), *config, "--calls-per-minute", "60", "--jobs", "1"]) == 0
    content = (drive.parent / "companion.toml").read_text().partition("[roi]")[0]
    part = (tmp_path / "out" / "tuned.toml").read_text()
    (tmp_path / "whole.toml").write_text(content + part)
    assert load_config(tmp_path / "whole.toml").words == {}
    assert part.startswith("# companion tune: a\\x0a[words]\\x0ab\\x07, 16 frames")


@pytest.mark.slow
def test_tuning_writes_what_to_put_into_the_configuration(drive: Path, tmp_path: Path, capsys: Out) -> None:
    answers = tmp_path / "answers.txt"
    answers.write_text("002.jpg = tap rock -1, go\n010.jpg = go\n")
    config = ["--config", str(drive.parent / "companion.toml"), "--out", str(tmp_path / "out")]
    wanted = ["--calls-per-minute", "60", "--keep-roi", "--jobs", "1", "--answers", str(answers)]
    assert companion(["tune", str(drive), *config, *wanted]) == 0
    found = figures(capsys)
    assert (found["frames"], found["named"]) == (16, 1)
    assert found["reached"] == (found["proposed"]["calls_per_minute"] <= 60)
    assert found["now"]["region"] == found["proposed"]["region"]
    part = (tmp_path / "out" / "tuned.toml").read_text()
    assert part.startswith("# companion tune: drive, 16 frames")
    rows = json.loads((tmp_path / "out" / "tuning.json").read_text())["each"]
    assert len(rows) == found["combinations"]
    assert found["proposed"] in rows
    page = (tmp_path / "out" / "tuning.html").read_text()
    assert page.count('class="plot"') == 1
    number = found["proposed"]["number"]
    assert f"companion tune --take {number} --from {tmp_path / 'out' / 'tuning.json'} --write" in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--calls-per-minute", "0"), "calls a minute"),
        (("--calls-per-minute", "nan"), "calls a minute"),
        (("--answers", "{answers}"), "no answer to a frame of this drive"),
        (("--jobs", "-1"), "--jobs -1"),
        (("--calls-per-minute", "0.7"), "the drive lasts 1.6 s, and"),
        (("--calls-per-minute", "0.7"), "drive of 86 s or more"),
        (("--answers", "{answers}.old"), "answers.txt.old: no such file or directory\n"),
        (("--take", "1", "--from", "{answers}.json"), "answers.txt.json: no such file or directory\n"),
    ],
)
def test_what_cannot_be_tuned_is_told(
    drive: Path, tmp_path: Path, capsys: Out, options: tuple[str, ...], told: str
) -> None:
    answers = tmp_path / "answers.txt"
    answers.write_text("elsewhere.jpg = go\n")
    config = ["--config", str(drive.parent / "companion.toml"), "--out", str(tmp_path / "out")]
    given = [one.format(answers=answers) for one in options]
    assert companion(["tune", str(drive), *config, *given]) == 2
    assert told in capsys.readouterr().err
