"""An evaluation that was stopped or killed goes on, and its figures are those of one run."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.cli import main
from anytraverse.evaluation import records
from anytraverse.evaluation.records import FILE

MakeDrive = Callable[..., Path]
Out = pytest.CaptureFixture[str]

ROOT = Path(__file__).parents[3]
DIRT, GRASS, BUSH, DRUM = 40, 90, 140, 190
WORDS = "dirt: 1; grass: 1; bush: -1"
SLOW = """
import sys, time
from types import SimpleNamespace
from tests.anytraverse.evaluation.conftest import Grey
from anytraverse.cli import main
from anytraverse.perception import KINDS

class Slow(Grey):
    def encode(self, image):
        time.sleep(0.05)
        return super().encode(image)

sys.modules["grey_eyes"] = SimpleNamespace(Grey=Slow)
KINDS["grey"] = ("grey_eyes", "Grey")
sys.exit(main(sys.argv[1:]))
"""

pytestmark = pytest.mark.usefixtures("grey")


def command(folder: Path, out: Path, *more: str, words: str = WORDS) -> list[str]:
    known = ["--prompts", words, "--drivable", "dirt path,grass", "--unknown", "barrel"]
    return [
        "evaluate",
        "--dataset",
        f"folder:{folder}",
        "--perceiver",
        "grey",
        "--out",
        str(out),
        *known,
        *more,
    ]


def evaluated(capsys: Out, arguments: list[str]) -> tuple[dict[str, Any], str]:
    """The JSON on the last line, without what was timed; and stderr."""
    assert main(arguments) == 0
    said = capsys.readouterr()
    figures: dict[str, Any] = json.loads(said.out.splitlines()[-1])
    del figures["ms_per_frame"]
    return figures, said.err


def refused(capsys: Out, arguments: list[str]) -> str:
    assert main(arguments) == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """Twenty frames, each a little different."""
    return make_drive(
        {
            number: ([[DIRT + number, GRASS, BUSH - number, DRUM]], [[0, 1, number % 3, 3]])
            for number in range(1, 21)
        }
    )


@pytest.mark.slow
def test_a_killed_run_goes_on_with_the_figures_of_one_run(drive: Path, tmp_path: Path, capsys: Out) -> None:
    arguments = command(drive, tmp_path / "killed")
    running = subprocess.Popen(
        [sys.executable, "-c", SLOW, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stderr is not None
    try:
        for line in running.stderr:
            if line.startswith("6/20 frames"):
                break
        running.send_signal(signal.SIGKILL)
        assert running.wait(10) == -signal.SIGKILL
    finally:
        running.kill()
        running.stderr.close()
    assert not (tmp_path / "killed" / "evaluation.json").exists()
    resumed, said = evaluated(capsys, arguments)
    whole, _ = evaluated(capsys, command(drive, tmp_path / "whole"))
    judged = re.search(r"^([0-9]+) frames were judged before and are not judged again", said, re.MULTILINE)
    assert judged is not None
    assert int(judged[1]) >= 6
    assert resumed == whole
    for name in ("frames.csv", "curve.csv", "results.md"):
        written = [(tmp_path / run / name).read_text().splitlines() for run in ("killed", "whole")]
        same = [[line for line in lines if "ms a frame" not in line] for lines in written]
        assert same[0] == same[1]


def test_a_finished_run_judges_only_what_it_draws(
    drive: Path, tmp_path: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = evaluated(capsys, command(drive, tmp_path / "out"))
    judged = 0
    encode = grey.encode

    def counted(self: Any, image: Any) -> Any:
        nonlocal judged
        judged += 1
        return encode(self, image)

    monkeypatch.setattr(grey, "encode", counted)
    again, _ = evaluated(capsys, command(drive, tmp_path / "out"))
    assert again == first
    assert judged == len(first["best"]) + len(first["worst"]) == 12


def test_other_classes_and_frames_need_no_judging_again(drive: Path, tmp_path: Path, capsys: Out) -> None:
    evaluated(capsys, command(drive, tmp_path / "out", "--every", "2"))
    figures, said = evaluated(capsys, command(drive, tmp_path / "out", "--drivable", "grass"))
    assert "\n10 frames were judged before" in said
    assert (figures["images"], figures["drivable"]) == (20, ["grass"])
    assert figures == evaluated(capsys, command(drive, tmp_path / "new", "--drivable", "grass"))[0]


def test_a_frame_that_was_labelled_anew_is_judged_again(drive: Path, tmp_path: Path, capsys: Out) -> None:
    evaluated(capsys, command(drive, tmp_path / "out"))
    os.utime(drive / "0003.png", ns=(1, 1))
    _, said = evaluated(capsys, command(drive, tmp_path / "out"))
    assert "\n19 frames were judged before" in said


def test_a_torn_frame_is_left_out_and_tried_again(drive: Path, tmp_path: Path, capsys: Out) -> None:
    whole = (drive / "0004.jpg").read_bytes()
    (drive / "0004.jpg").write_bytes(whole[:100])
    figures, said = evaluated(capsys, command(drive, tmp_path / "out"))
    assert (figures["images"], figures["torn"]) == (19, 1)
    assert "0004.jpg: torn, or not a picture, skipped" in said
    (drive / "0004.jpg").write_bytes(whole)
    assert evaluated(capsys, command(drive, tmp_path / "out"))[0]["images"] == 20


def test_a_folder_of_which_all_is_torn_is_refused(drive: Path, tmp_path: Path, capsys: Out) -> None:
    for file in drive.glob("*.jpg"):
        file.write_bytes(b"")
    assert "no frame that can be read" in refused(capsys, command(drive, tmp_path / "out"))


def test_other_words_are_judged_beside_the_first_ones(drive: Path, tmp_path: Path, capsys: Out) -> None:
    first, _ = evaluated(capsys, command(drive, tmp_path / "out"))
    _, said = evaluated(capsys, command(drive, tmp_path / "out", words="dirt: 1; grass: 0.9"))
    assert "judged before" not in said
    again, said = evaluated(capsys, command(drive, tmp_path / "out"))
    assert "\n20 frames were judged before" in said
    assert again == first


def test_another_perceiver_is_not_mixed_with_this_one(
    drive: Path, tmp_path: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundle = tmp_path / "bundle"
    bundle.mkdir()
    (bundle / "manifest.json").write_text("one calibration")
    arguments = [*command(drive, tmp_path / "out"), "--perceiver", f"grey:{bundle}"]
    evaluated(capsys, arguments)
    evaluated(capsys, arguments)
    (bundle / "manifest.json").write_text("another")
    line = refused(capsys, arguments)
    assert "holds another run, with other model: choose another --out, or remove" in line
    (bundle / "manifest.json").write_text("one calibration")
    monkeypatch.setattr(grey, "precision", "int8", raising=False)
    assert "with other model" in refused(capsys, arguments)


@pytest.mark.slow
def test_the_least_recently_used_words_are_forgotten_first(
    drive: Path, tmp_path: Path, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "MOST_WORDS", 2)
    for words in ("dirt: 1", "grass: 1", "dirt: 1", "bush: 1"):
        evaluated(capsys, command(drive, tmp_path / "out", words=words))
    for words, kept in (("dirt: 1", True), ("grass: 1", False)):
        _, said = evaluated(capsys, command(drive, tmp_path / "out", words=words))
        assert ("20 frames were judged before" in said) == kept


def test_two_runs_do_not_write_at_once(drive: Path, tmp_path: Path, capsys: Out) -> None:
    evaluated(capsys, command(drive, tmp_path / "out"))
    other = sqlite3.connect(tmp_path / "out" / FILE)
    other.execute("BEGIN EXCLUSIVE")
    try:
        line = refused(capsys, command(drive, tmp_path / "out"))
        assert "another run writes it: wait, or choose another --out" in line
    finally:
        other.close()


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: file.write_bytes(b"no database" * 1000),
        lambda file: _execute(file, "UPDATE tallies SET tally = x'00' WHERE name = '0002.jpg'"),
        lambda file: _execute(file, "UPDATE run SET settings = '{'"),
    ],
)
def test_damaged_records_are_named_with_the_remedy(
    drive: Path, tmp_path: Path, capsys: Out, damage: Callable[[Path], None]
) -> None:
    evaluated(capsys, command(drive, tmp_path / "out"))
    damage(tmp_path / "out" / FILE)
    line = refused(capsys, command(drive, tmp_path / "out"))
    assert f"{FILE} is damaged" in line
    assert "remove it, and run again" in line


def _execute(file: Path, statement: str) -> None:
    connection = sqlite3.connect(file)
    with connection:
        connection.execute(statement)
    connection.close()


def test_a_perceiver_that_gives_nonsense_is_named_with_the_frame(
    drive: Path, tmp_path: Path, capsys: Out, grey: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grey, "broken", True)
    assert "0001.jpg: attention maps are not finite" in refused(capsys, command(drive, tmp_path / "out"))
