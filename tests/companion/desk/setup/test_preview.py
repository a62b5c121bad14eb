"""The live picture: what the camera's process sends, and what becomes of one that fails."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.regions import Box
from companion.cameras import CameraOptions
from companion.desk.setup import preview
from companion.desk.setup.preview import Preview, PreviewPicture, _read
from companion.desk.setup.preview_process import show
from tests.waiting import wait_for

ROI = Box(0.3, 0.6, 0.7, 0.95)
OPTIONS = CameraOptions(playback=30.0, loop=True)


@pytest.fixture
def source(tmp_path: Path) -> str:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name, grey in (("a", 90), ("b", 120)):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((60, 80, 3), grey, np.uint8))
    return f"folder:{folder}"


def test_the_process_sends_what_is_measured_with_each_picture(source: str) -> None:
    ours, theirs = multiprocessing.Pipe(duplex=False)
    thread = threading.Thread(target=show, args=(source, OPTIONS, ROI, theirs), daemon=True)
    thread.start()
    assert ours.poll(20.0)
    seen, jpeg = _read(ours.recv_bytes())
    assert (seen.trouble, seen.width, seen.height) == ("", 80, 60)
    assert seen.rate == pytest.approx(30.0, rel=0.7)
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (60, 80, 3)
    ours.close()
    thread.join(10.0)
    assert not thread.is_alive(), "it ends where nobody reads it"


@pytest.mark.parametrize(
    "message", [b"", b"rubbish\n", b"[]\n", b"{}\nJPEG", json.dumps({"trouble": 1}).encode() + b"\n"]
)
def test_a_process_that_sends_rubbish_is_said_to(message: bytes) -> None:
    seen, jpeg = _read(message)
    assert "cannot be read" in seen.trouble
    assert jpeg == b""


@pytest.fixture
def live() -> Iterator[Preview]:
    made = Preview()
    yield made
    made.close()


def shown(live: Preview, source: str, fits: Callable[[PreviewPicture], object]) -> PreviewPicture:
    def look() -> PreviewPicture | None:
        found = live.ask(source, OPTIONS, ROI)
        return found if fits(found) else None

    return wait_for(look, 60.0)


@pytest.mark.slow
def test_one_camera_is_open_at_a_time_and_one_that_fails_says_why(source: str, live: Preview) -> None:
    first = shown(live, source, lambda one: one.jpeg)
    assert first.seen.width == 80
    absent = shown(live, "folder:/nowhere", lambda one: one.seen.trouble and one.number > first.number)
    assert "nowhere" in absent.seen.trouble
    assert absent.jpeg == b""
    again = shown(live, source, lambda one: one.jpeg)
    assert again.number > absent.number


@pytest.mark.slow
def test_a_process_that_dies_or_hangs_is_said_to_and_started_again(
    source: str, live: Preview, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = preview.COMMAND
    monkeypatch.setattr(preview, "AGAIN", 0.1)
    monkeypatch.setattr(preview, "COMMAND", [sys.executable, "-c", "raise SystemExit(3)"])
    assert "exit code 3" in shown(live, source, lambda one: one.number).seen.trouble
    monkeypatch.setattr(preview, "SILENT", 0.5)
    monkeypatch.setattr(preview, "COMMAND", [sys.executable, "-c", "import time; time.sleep(60)"])
    shown(live, "folder:/other", lambda one: "hangs" in one.seen.trouble)
    monkeypatch.setattr(preview, "SILENT", 30.0)
    monkeypatch.setattr(preview, "COMMAND", command)
    shown(live, source, lambda one: one.jpeg)


@pytest.mark.slow
def test_nothing_of_the_current_folder_is_imported(
    source: str, live: Preview, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "of somebody else"
    folder.mkdir()
    for name in ("runpy", "multiprocessing", "secrets", "types", "random", "cv2", "companion"):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    monkeypatch.chdir(folder)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    shown(live, source, lambda one: one.jpeg)
    assert not (tmp_path / "ran").exists()


@pytest.mark.slow
def test_a_program_that_is_the_camera_ends_with_the_picture(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    made = Preview()
    pipe = CameraOptions(width=64, height=48, pixel_format="rgb24")
    command = f"pipe:sh -c 'sleep 60 & echo $! > {told}; wait'"

    def started() -> str:
        made.ask(command, pipe, ROI)
        return told.read_text().strip() if told.exists() else ""

    number = wait_for(started, 60.0)
    made.close()
    wait_for(lambda: not _runs(number), 5.0)


def _runs(number: str) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


def test_control_c_in_the_terminal_does_not_reach_the_camera_s_process() -> None:
    ours, theirs = multiprocessing.Pipe()
    process = preview._started(theirs.fileno())
    try:
        assert os.getsid(process.pid) == process.pid
    finally:
        ours.close()
        process.kill()
        process.wait(10.0)
