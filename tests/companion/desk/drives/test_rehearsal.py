"""`companion rehearse` judges each frame of a drive, and remembers what is answered at the desk."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.engine import AnyTraverse
from companion.cli import main
from companion.config import load_config
from companion.desk.drives.desk import AnswerFile, Terminal
from companion.desk.drives.drive import DriveError, DriveFrame
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.rehearsal import AskedCall, Rehearsal, learnt, rehearse
from companion.vision.warm_up import load_engine
from companion.wire.ids import Reasons
from tests.companion.desk.drives.filmed import film
from tests.companion.link.payloads import CALL

TORN = 10


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated trail in the forest and then on gravel. File 10 is torn; companion.toml is beside it."""
    folder = tmp_path_factory.mktemp("drive")
    film(folder, 0.35)
    (folder / f"{TORN:03d}.jpg").write_bytes(b"torn")
    return folder


def rehearsed(drive: Path, out: Path, *more: str) -> dict[str, Any]:
    config = str(drive.parent / "companion.toml")
    assert main(["rehearse", str(drive), "--config", config, "--out", str(out), "--no-ask", *more]) == 0
    told: dict[str, Any] = json.loads((out / "calls.json").read_text())
    told.pop("seconds")
    return told


@pytest.fixture(scope="module")
def first(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The drive rehearsed without an answer."""
    out = tmp_path_factory.mktemp("out") / "first"
    return out, rehearsed(drive, out)


@pytest.mark.slow
def test_no_frame_is_left_out_and_the_same_drive_raises_the_same_calls(
    drive: Path, first: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    out, told = first
    names = sorted(path.name for path in drive.iterdir())
    lines = (out / "frames.jsonl").read_text()
    rows = [json.loads(line) for line in lines.splitlines()]
    assert [row["file"] for row in rows] == [name for name in names if name != f"{TORN:03d}.jpg"]
    assert (told["frames"], told["torn"], told["drive_s"]) == (len(rows), 1, len(names) / 10)
    assert told["calls"] == len(told["each"]) == sum(told["by_tenth"]) >= 1
    assert told["each"][0]["frame"] == names[told["at_call"][0] - 1]
    assert told["each"][0]["reasons"] == ["unknown_scene"]
    assert told["not_ok"] == sum(not row["ok"] for row in rows)
    for kind in ("raw", "large"):
        assert cv2.imread(str(out / "calls" / f"1-{kind}.jpg")) is not None
    page = (out / "index.html").read_text()
    assert page.count("<img ") == 2 * told["calls"]
    assert "http" not in page
    assert not (out / "memory.jsonl").exists(), "nobody answered"
    assert rehearsed(drive, tmp_path / "again") == told
    assert (tmp_path / "again" / "frames.jsonl").read_text() == lines


def test_a_place_that_was_answered_is_known_the_next_time(
    drive: Path, first: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = first[1]["each"][0]["frame"]
    answers = tmp_path / "answers.txt"
    lines = [f"{frame} = no such word: 1", f"{frame} = dirt path: 1; tree: -1, go", "999.jpg = go"]
    answers.write_text("\n".join(["# the gravel", *lines]))
    told = rehearsed(drive, tmp_path / "out", "--answers", str(answers))
    said = capsys.readouterr().out
    assert "999.jpg: an answer was not used" in said
    assert f"{frame}: `no such word: 1`: nothing changed:" in said
    assert [one["taken"] for one in told["each"][0]["answers"]] == [False, True]
    assert told["answered"] == 1
    memory = tmp_path / "out" / "memory.jsonl"
    assert len(memory.read_text().splitlines()) == 2, "a header and one scene"
    again = rehearsed(drive, tmp_path / "again", "--memory", str(memory))
    assert again["calls"] < told["calls"]
    assert again["matches"] > told["matches"]
    assert AnswerFile(tmp_path / "out" / "answers.txt").left() == [frame], "they can be given again"


def test_answers_outlive_a_second_run_an_error_and_an_odd_name(
    drive: Path, first: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = tmp_path / "drive"
    odd.mkdir()
    shutil.copy(drive.parent / "companion.toml", tmp_path)
    for path in drive.iterdir():
        shutil.copy(path, odd / f" {path.stem}\n\udcff = a.jpg")
    frame = f"{first[1]['each'][0]['frame'][:3]}\\x0a\\xdcff = a.jpg"
    answers = tmp_path / "answers.txt"
    answers.write_bytes(f"\ufeff# ours\r\n{frame} = dirt path: 1; tree: -1, go\r\n".encode())
    out = tmp_path / "out"
    assert rehearsed(odd, out, "--answers", str(answers))["answered"] == 1
    assert " = a.jpg = dirt path: 1; tree: -1, go\n" in (out / "answers.txt").read_text()
    again = ["rehearse", str(odd), "--config", str(tmp_path / "companion.toml"), "--out", str(out)]
    for more in ([], ["--answers", str(out / "answers.txt")]):
        assert main([*again, "--no-ask", *more]) == 2
        assert "answers.txt holds answers, which would be lost: give another --out" in capsys.readouterr().err
    assert AnswerFile(out / "answers.txt").left() == [frame]
    answers.write_bytes(b"\xff\xfe#\0")
    assert main([*again[:-1], str(tmp_path / "new"), "--answers", str(answers)]) == 2
    assert "answers.txt is no text in UTF-8" in capsys.readouterr().err
    assert not (tmp_path / "new").exists(), "nothing is cleared or made before all is read"


def test_answers_outlive_a_disk_that_fails(
    drive: Path, first: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Failing:
        title, count = "drive", 40

        def frames(self) -> Iterator[DriveFrame]:
            yield from open_drive(str(drive), 10.0).frames()
            raise OSError("input/output error")

    monkeypatch.setattr("companion.desk.drives.rehearsing.open_drive", lambda _where, _rate: Failing())
    answers, line = tmp_path / "answers.txt", f"{first[1]['each'][0]['frame']} = dirt path: 1; tree: -1, go"
    answers.write_text(line)
    config = ["--config", str(drive.parent / "companion.toml"), "--answers", str(answers)]
    assert main(["rehearse", "it", *config, "--out", str(tmp_path / "out"), "--no-ask"]) == 2
    assert line in (tmp_path / "out" / "answers.txt").read_text().splitlines()


def test_a_go_after_stay_is_not_remembered_as_a_persons(drive: Path, tmp_path: Path) -> None:
    found, lines = Rehearsal(), iter(["stay", "look"])
    config = load_config(drive.parent / "companion.toml")
    judge = DriveJudge(config, load_engine(config, None)[0])
    frames = open_drive(str(drive), 10.0)
    rehearse(frames, judge, lambda _call, _told: next(lines, None), tmp_path, found, lambda _number: None)
    assert [said.taken for said in found.calls[0].said] == [True, True]
    assert not found.calls[0].by_person
    assert len(learnt(judge.engine.memory, 0, found.calls).history) == 0


@pytest.mark.parametrize(
    ("line", "why"),
    [("0001.png go", "write it as"), ("0001.png = bush", "needs its weight"), ("0001.png = ", "write it as")],
)
def test_a_line_that_is_no_answer_is_named(tmp_path: Path, line: str, why: str) -> None:
    path = tmp_path / "answers.txt"
    path.write_text(f"# fine\n{line}\n")
    with pytest.raises(DriveError, match=rf"answers\.txt, line 2: .*{why}"):
        AnswerFile(path)


@pytest.fixture(scope="module")
def answered(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[AnyTraverse, Rehearsal]:
    """The drive, at whose first call somebody tapped a drum."""
    found, lines = Rehearsal(), iter(["tap drum: -1 0.4 0.5 0.6 0.8; water: -1, go"])
    config = load_config(drive.parent / "companion.toml")
    judge = DriveJudge(config, load_engine(config, None)[0])
    out, frames = tmp_path_factory.mktemp("answered"), open_drive(str(drive), 10.0)
    rehearse(frames, judge, lambda _call, _told: next(lines, None), out, found, lambda _number: None)
    assert found.calls[0].by_person
    return judge.engine, found


def call(number: int = 1) -> AskedCall:
    return AskedCall(number, "017.png", 1.7, CALL, np.zeros(4, np.float32), b"", b"")


def test_somebody_at_the_terminal_sees_why_and_answers_skips_or_quits(
    answered: tuple[AnyTraverse, Rehearsal],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = iter(["?", "help", "tap drum -1, go", "", "quit"])
    monkeypatch.setattr("builtins.input", lambda _prompt: next(lines))
    desk = Terminal(tmp_path, *answered)
    assert desk.ask(call(), "") == "tap drum -1, go"
    said = capsys.readouterr().out
    assert "C1 at 1.7 s, 017.png: " in said
    assert f"{tmp_path}/calls/1-large.jpg" in said
    assert said.count("not ask about this place again") == 2, "by ? and by help"
    assert desk.ask(call(), "C1 stays open: still unknown") is None
    assert "stays open" in capsys.readouterr().out
    with pytest.raises(KeyboardInterrupt):
        desk.ask(call(2), "")


def test_an_answer_at_the_terminal_that_turns_a_sign_must_be_typed_twice(
    answered: tuple[AnyTraverse, Rehearsal],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = iter(["water: 1, go", "water: -1, go", "water: 1, go", "tap water 1, go", "tap water 1, go"])
    monkeypatch.setattr("builtins.input", lambda _prompt: next(lines))
    desk = Terminal(tmp_path, *answered)
    assert desk.ask(call(), "") == "water: -1, go"
    assert "water was -1: repeat it to turn it" in capsys.readouterr().out
    assert desk.ask(call(), "") == "tap water 1, go"


def test_what_is_said_again_by_one_word_and_turns_a_sign_is_asked_for_twice_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = iter(["same", "same"])
    monkeypatch.setattr("builtins.input", lambda _prompt: next(lines))
    memory = SimpleNamespace(preferences={"drum": 0.8}, given={"drum": 0.8}, matched=None)
    desk = Terminal(tmp_path, SimpleNamespace(memory=memory), SimpleNamespace(calls=[]))  # type: ignore[arg-type]
    desk._asked, desk._same = 1, "tap drum: -1, go"
    assert desk.ask(call(), "") == "tap drum: -1, go"
    assert "drum was 0.8: repeat it to turn it" in capsys.readouterr().out
    assert list(lines) == []


def like(answered: tuple[AnyTraverse, Rehearsal]) -> AskedCall:
    """A call for a thing in the scene of the first one."""
    there = answered[1].calls[0]
    return AskedCall(99, "040.png", 4.0, replace(CALL, id=99), there.embedding, b"", b"")


def test_what_a_thing_was_named_in_a_like_scene_is_said_again_by_one_word(
    answered: tuple[AnyTraverse, Rehearsal],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = iter(["same", "same", ""])
    monkeypatch.setattr("builtins.input", lambda _prompt: next(lines))
    desk = Terminal(tmp_path, *answered)
    assert desk.ask(like(answered), "") == "tap drum: -1, go"
    said = capsys.readouterr().out
    assert "  Most like call C1 (1.00): you said " in said
    assert "  same: Still the drum you named at C1: −1, and go" in said
    ground = replace(like(answered), id=100, data=replace(CALL, reasons=Reasons.UNKNOWN_SCENE))
    assert desk.ask(ground, "") == "same", "no thing is asked about: it is no answer, as what takes it says"
    assert "Still the" not in capsys.readouterr().out


def test_a_picture_is_decoded_once_and_only_when_it_is_looked_at(drive: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(drive, copy)
    first, second, *_ = open_drive(str(copy), 10.0).frames()
    assert first.image is not None
    for picture in copy.iterdir():
        picture.unlink()
    assert first.image is not None
    assert (second.image, bool(second.name)) == (None, True)


def test_a_video_is_thinned_out_to_the_rate_of_the_rover(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (64, 48))  # type: ignore[attr-defined]
    for number in range(60):
        video.write(np.full((48, 64, 3), 4 * number, np.uint8))
    video.release()
    drive = open_drive(str(path), 10.0)
    frames = list(drive.frames())
    assert drive.count == len(frames) == 20
    assert [frame.name for frame in frames[:3]] == ["0.00 s", "0.10 s", "0.20 s"]
    assert np.diff([frame.at for frame in frames]) == pytest.approx(0.1)
    assert frames[3].image is not None
    assert abs(int(frames[3].image.mean()) - 36) < 4


@pytest.mark.parametrize(
    ("where", "why"),
    [("nowhere", "no folder, and no video"), ("folder:nowhere", "cannot be read"), ("v4l2:0", "is no drive")],
)
def test_what_is_no_drive_is_refused_with_what_to_give(where: str, why: str) -> None:
    with pytest.raises(DriveError, match=why):
        open_drive(where, 10.0)


def test_a_folder_with_other_files_is_left_as_it_is(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    config = str(drive.parent / "companion.toml")
    assert main(["rehearse", str(drive), "--config", config, "--out", str(tmp_path)]) == 2
    assert "which no rehearsal wrote" in capsys.readouterr().err
    assert (tmp_path / "mine.txt").read_text() == "mine"
