"""MAVSDK's camera plug-in finds the companion, and points at a thing in its video."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.config.video import VideoSection
from companion.desk.check.here import read_status
from companion.desk.check.observers import missing_of
from tests.waiting import wait_for

HERE = Path(__file__).parent
LONG_ENOUGH = 5.0
"""Seconds for which a viewer must have seen a call's frame, and some to connect."""
_VIEW = """
import sys, cv2
capture = cv2.VideoCapture(sys.argv[1], cv2.CAP_FFMPEG)
while capture.read()[0]:
    pass
"""


@pytest.fixture(scope="module")
def more_config() -> str:
    return '\n[video]\nlisten = "127.0.0.1:0"\n'


@pytest.fixture
def viewer() -> Iterator[Callable[[str], None]]:
    running: list[subprocess.Popen[bytes]] = []
    yield lambda url: running.append(subprocess.Popen([sys.executable, "-c", _VIEW, url]))
    for one in running:
        one.kill()
        one.wait(5.0)


def test_it_finds_the_camera_and_its_taps_answer_a_call(
    stage: Any, start: Callable[..., Any], viewer: Callable[[str], None]
) -> None:
    if missing := missing_of(VideoSection().python, VideoSection().encoder):
        pytest.skip(missing)
    stage.wait_until_ok()
    camera = start(str(HERE / "mavsdk_camera.py"), stage.ground.replace("udpout:", "udpout://"))
    assert "AnyTraverse" in camera.wait_for("found: ")
    url = camera.wait_for("video: ").partition(": ")[2]
    assert url.startswith("rtsp://127.0.0.1:")
    assert camera.ask("tap 0.4 0.5 0.6 0.7", "tap: ") != "tap: done", "nothing is open"
    stage.control.start()
    wait_for(lambda: read_status(stage.out / "state")[1].get("state") == "calling", 60.0)
    assert camera.ask("tap 0.4 0.5 0.6 0.7", "tap: ") != "tap: done", "nobody sees what is tapped"
    viewer(url)
    time.sleep(LONG_ENOUGH)
    camera.ask_until("tap 0.4 0.5 0.6 0.7", "tap: done", every=2.0)
    assert "answer to 1: " in (stage.out / "daemon.log").read_text()
    assert camera.ask("stop", "stop: ") == "stop: done"
