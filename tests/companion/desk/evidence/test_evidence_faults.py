"""What the log tells of faults, and which of them docs/faults.md has."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from companion.desk.evidence.faults import FAULTS, faults_part
from companion.desk.evidence.log import read_log
from companion.desk.evidence.parts import utc
from companion.storage.log_file import FOLDER as LOGS
from companion.storage.log_file import NAME as LOG
from tests.companion.desk.evidence.told import NOON, figures, sources, table

DOCS = Path(__file__).parents[4] / "docs"


def logged(folder: Path, *lines: tuple[float, str], name: str = LOG) -> None:
    (folder / LOGS).mkdir(parents=True, exist_ok=True)
    text = ""
    for at, line in lines:
        stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
        text += f"{stamp},{round(at % 1 * 1000):03d} WARNING companion.daemon.health: {line}\n"
    (folder / LOGS / name).write_text(text)


def test_the_log_alone_tells_each_fault_and_how_long_it_stood(tmp_path: Path) -> None:
    logged(tmp_path, (NOON, "ready: policy hold"), (NOON + 1, "fault: camera frozen"), name=f"{LOG}.1")
    logged(
        tmp_path,
        (NOON + 9.5, "the fault is over"),
        (NOON + 20, "fault: camera silent: no good frame for 5 s: check cable"),
        (NOON + 21, "fault: autopilot silent: check its power"),
        (NOON + 24, "the autopilot is heard again"),
        (NOON + 30, "link lost: gone"),
        (NOON + 33, "link is back"),
        (NOON + 40, "the companion was stalled for 1.2 s: check the load"),
        (NOON + 41, "fault: something new"),
        (NOON + 50, "ready: policy hold"),
    )
    part = faults_part(sources(tmp_path, logged=read_log(tmp_path)))
    kinds = {one["fault"]: one for one in table(part.document(), "Kinds of faults")}
    assert kinds["camera frozen"]["seen"] == 1
    assert kinds["camera frozen"]["stood, at most, s"] == pytest.approx(6.5)
    assert kinds["no pictures from the camera"]["seen"] == 1
    assert kinds["no pictures from the camera"]["stood, at most, s"] is None, "it stood as it ended"
    assert kinds["autopilot silent"]["stood, at most, s"] == pytest.approx(3.0)
    assert kinds["link lost"]["stood, at most, s"] == pytest.approx(3.0)
    assert kinds["main loop stopped"]["seen"] == 1
    assert kinds["vision hangs"]["seen"] == "not in this log"
    assert f"This log begins {utc(NOON)}" in part.note
    told = figures(part.document())
    assert told["faults of other kinds"] == 0, "the third began while one stood"
    assert told["starts of the companion"] == 2
    assert told["ends without being told to stop: killed, crashed, or without power"] == 2


def test_an_end_that_was_ordered_does_not_hide_a_crash(tmp_path: Path) -> None:
    ended = "told to stop, and stopped"
    lines = [ended, "ready: policy hold", "ready: policy hold", ended, "ready: policy hold"]
    logged(tmp_path, *((NOON + at, line) for at, line in enumerate(lines)))
    for running, unclean in ((True, 1), (False, 2)):
        told = figures(faults_part(sources(tmp_path, logged=read_log(tmp_path), running=running)).document())
        assert told["ends without being told to stop: killed, crashed, or without power"] == unclean


def test_what_a_clock_lengthens_that_was_set_is_not_told(tmp_path: Path) -> None:
    logged(tmp_path, (100.0, "link lost: gone"), (NOON, "link is back"))
    rows = table(faults_part(sources(tmp_path, logged=read_log(tmp_path))).document(), "Kinds of faults")
    (lost,) = [one for one in rows if one["fault"] == "link lost"]
    assert (lost["seen"], lost["stood, at most, s"]) == (1, None)


def test_a_part_of_the_log_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    logged(tmp_path, (NOON, "ready: policy hold"))
    (tmp_path / LOGS / f"{LOG}.1").mkdir()
    part = faults_part(sources(tmp_path, logged=read_log(tmp_path)))
    assert "a part of the log" in [one.what for one in part.unknown]


def test_a_log_of_rubbish_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / LOGS).mkdir()
    (tmp_path / LOGS / LOG).write_bytes(
        bytes(range(256)) * 50 + b"\n2026-99-99 99:99:99,999 ERROR a: fault: x\n"
    )
    read = read_log(tmp_path)
    assert read.lines == ()
    assert faults_part(sources(tmp_path, logged=read)).unknown[0].what == "which faults were seen"


def test_the_faults_are_rows_of_the_page() -> None:
    page_text = (DOCS / "faults.md").read_text()
    for kind in FAULTS:
        for name in kind.rows:
            assert f"| {name} |" in page_text
