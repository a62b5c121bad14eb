"""The video process: real GStreamer, and OpenCV as a viewer."""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from companion.config import Config
from companion.config.schema import JournalSection
from companion.config.video import VideoSection
from companion.desk.check.observers import missing_of
from companion.observers.recording.messages import RecordedMessage
from companion.observers.video.rtsp_server import REPORT, STALE_AFTER
from companion.observers.video.video import Video, VideoChild
from companion.system.watchdog import Restarts
from tests.companion.observers.supervisor import Supervisor

SOON = 30.0
LIMITS = Restarts(silent_for=3.0, loading=30.0, first=0.1, longest=0.2)
GREY = 120


@cache
def _missing() -> str:
    settings = VideoSection()
    return missing_of(settings.python, settings.encoder)


def jpeg(bright: int) -> bytes:
    picture = np.full((96, 128, 3), bright, np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


class Stage(Supervisor):
    """The supervisor's end, and one viewer."""

    def __init__(
        self,
        folder: Path,
        listen: str = "127.0.0.1:0",
        launch: Callable[..., VideoChild] = VideoChild,
        **settings: Any,
    ) -> None:
        """settings: more of [video]."""
        config = replace(
            Config(),
            video=VideoSection(listen, rate=15.0, **settings),
            journal=JournalSection(folder=str(folder)),
        )
        self.service = self.video = Video(config, launch, LIMITS)
        self.frame, self.bright = 1, GREY
        self.told_at = 0.0
        self.feeds = True

    def work(self, now: float, _messages: Sequence[RecordedMessage]) -> None:
        self.video.poll(now)
        if self.feeds and self.video.watched and now - self.told_at > 0.05:
            self.told_at = now
            self.video.show(self.frame, jpeg(self.bright))

    def until(self, fits: Callable[[], object], seconds: float = SOON) -> None:
        super().until(fits, seconds)


class Viewer:
    """Reads the stream in a process of its own, since OpenCV blocks until the first picture comes."""

    def __init__(self, url: str) -> None:
        import subprocess
        import sys

        self._process = subprocess.Popen(
            [sys.executable, "-c", _VIEW, url], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
        )
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self.seen: list[tuple[int, int]] = []
        """Mean and brightest pixel of each picture."""

    def look(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout.readlines():
            mean, most = map(int, line.split())
            self.seen.append((mean, most))

    def close(self) -> None:
        self._process.kill()
        self._process.wait(5.0)
        assert self._process.stdout is not None
        self._process.stdout.close()


_VIEW = """
import os, sys
os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = (
    "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay|fpsprobesize;0"
)
import cv2
capture = cv2.VideoCapture(sys.argv[1], cv2.CAP_FFMPEG)
while True:
    done, picture = capture.read()
    if not done:
        sys.exit("no picture")
    print(round(picture.mean()), picture.max(), flush=True)
"""


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    if _missing():
        pytest.skip(_missing())
    stage = Stage(tmp_path)
    yield stage
    stage.close()


def test_a_viewer_sees_what_is_shown_and_the_supervisor_knows_which_frame_that_is(stage: Stage) -> None:
    stage.until(lambda: stage.video.url != "" and not stage.video.trouble)
    assert stage.video.url.endswith("/anytraverse")
    assert not stage.video.watched, "nothing is drawn or encoded for nobody"
    with closing(Viewer(stage.video.url)) as viewer:

        def sees(bright: int) -> bool:
            viewer.look()
            return bool(viewer.seen) and abs(viewer.seen[-1][0] - bright) <= 4

        stage.until(lambda: sees(GREY))
        stage.until(lambda: stage.video.shown_for(1, time.monotonic()) > 0.0)
        stage.frame, stage.bright = 2, 200
        stage.until(lambda: sees(200))
        stage.until(lambda: stage.video.shown_for(2, time.monotonic()) > 0.1)
        assert stage.video.shown_for(1, time.monotonic()) == 0.0
        # Whoever connects and asks for nothing keeps nobody out.
        address = urlsplit(stage.video.url)
        idle = [socket.create_connection((address.hostname, address.port), 5.0) for _ in range(30)]
        stage.until(lambda: select.select(idle[:1], [], [], 0.0)[0] != [])
        assert idle[0].recv(1) == b"", "closed"
        stage.until(lambda: stage.video.shown_for(2, time.monotonic()) > 0.2)
        for one in idle:
            one.close()
        # Without new pictures the old one says so, and no tap can mean it.
        stage.feeds, stopped = False, time.monotonic()
        stage.until(lambda: stage.video.shown_for(2, time.monotonic()) == 0.0)
        assert time.monotonic() - stopped > STALE_AFTER - 0.5
        stage.until(lambda: sees(200) or viewer.seen[-1][1] > 230)
        assert stage.video.watched


@pytest.mark.parametrize(
    "said",
    [
        b"x",
        REPORT.pack(0, 0, 0),
        REPORT.pack(8554, 1, 2),
        REPORT.pack(8554, 1, 1) + b"x",
        REPORT.pack(8555, 1, 1),
    ],
)
def test_a_process_that_says_nonsense_is_started_again(tmp_path: Path, said: bytes) -> None:
    import sys

    code = f"import socket, sys, time; socket.socket(fileno=int(sys.argv[1])).send({said!r}); time.sleep(30)"

    def launch(_command: object) -> VideoChild:
        return VideoChild((sys.executable, "-c", code))

    with closing(Stage(tmp_path, "127.0.0.1:8554", launch=launch)) as stage:
        stage.until(lambda: stage.video.figures()["restarts"] >= 1)
        assert stage.video.trouble == "sent nonsense"
        assert (stage.video.url, stage.video.watched) == ("", False)


def test_a_python_without_gstreamer_is_said_and_harms_nothing(tmp_path: Path) -> None:
    stage = Stage(tmp_path, python="/nowhere/python3")
    stage.until(lambda: stage.video.trouble != "starting")
    assert stage.video.trouble == "cannot be started on /nowhere/python3 (no such file or directory)"
    assert missing_of("/nowhere/python3", "x264enc").startswith("/nowhere/python3 cannot be run")


def test_a_port_that_is_taken_is_said(tmp_path: Path) -> None:
    if _missing():
        pytest.skip(_missing())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        stage = Stage(tmp_path, f"127.0.0.1:{taken.getsockname()[1]}")
        stage.until(lambda: stage.video.trouble not in ("", "starting"))
        stage.close()
    assert stage.video.trouble == "ended: another program has its port: set another [video] listen"


def test_what_gstreamer_lacks_is_named_and_said(tmp_path: Path) -> None:
    if _missing():
        pytest.skip(_missing())
    stage = Stage(tmp_path, encoder="nosuchenc bitrate=1")
    stage.until(lambda: "GStreamer lacks what the video needs: sudo apt install" in stage.video.trouble)
    stage.close()
    assert missing_of("/usr/bin/python3", "nosuchenc bitrate=1") == "no nosuchenc in GStreamer"


def test_no_camera_is_no_process(tmp_path: Path) -> None:
    video = Video(replace(Config(), journal=JournalSection(folder=str(tmp_path))))
    video.poll(time.monotonic())
    assert video.figures() == {
        "url": "",
        "watched": False,
        "trouble": "switched off by [video] listen",
        "restarts": 0,
    }


def test_an_address_with_a_password_is_told_to_ground_stations_and_not_shown(tmp_path: Path) -> None:
    settings = VideoSection(listen="0.0.0.0:8554", url="rtsp://me:SECRET@rover.local:8554/SECRET")
    video = Video(replace(Config(), journal=JournalSection(folder=str(tmp_path)), video=settings))
    video.trouble = ""
    assert video.url == settings.url
    assert video.figures()["url"] == "rtsp://rover.local:8554/..."
    video._settings = replace(settings, url="")
    assert video.figures()["url"] == "rtsp://0.0.0.0:8554/anytraverse"
