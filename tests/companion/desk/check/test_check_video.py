"""What the check says of the MAVLink camera's video."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config
from companion.config.video import VideoSection
from companion.desk.check import observers
from companion.desk.check.observers import check_video
from companion.desk.check.rover import CheckedRover


def found(settings: VideoSection, running: Mapping[str, Any] | None = None) -> tuple[str, str]:
    rover = CheckedRover(replace(Config(), video=settings), "", Path(), running)
    (finding,) = check_video(rover)
    return finding.verdict.name, finding.text


def test_without_an_address_there_is_no_camera_and_all_is_well() -> None:
    assert found(VideoSection())[0] == "PASS"


def test_what_gstreamer_lacks_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observers, "missing_of", lambda _python, _encoder: "no x264enc in GStreamer")
    verdict, text = found(VideoSection("127.0.0.1:0"))
    assert verdict == "WARN"
    assert text.startswith("no x264enc in GStreamer: sudo apt install python3-gi gir1.2-gst-rtsp-server-1.0 ")
    monkeypatch.setattr(observers, "missing_of", lambda _python, _encoder: "")
    assert found(VideoSection("127.0.0.1:0")) == (
        "PASS",
        "127.0.0.1:0 is free, and will show it to whoever reaches that port",
    )


def test_a_companion_that_runs_says_where_its_video_is() -> None:
    url = "rtsp://rover.local:8554/anytraverse"
    told = {"url": url, "watched": False, "trouble": "", "restarts": 0}
    assert found(VideoSection("127.0.0.1:0"), {"video": told}) == (
        "PASS",
        f"{url} shows it to whoever reaches that port",
    )
    lost = {"url": "", "trouble": "ended: SIGSEGV"}
    assert found(VideoSection("127.0.0.1:0"), {"video": lost})[0] == "WARN"
