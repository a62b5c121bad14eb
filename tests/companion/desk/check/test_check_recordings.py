"""What the check says of recordings and of the live view."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config
from companion.config.schema import JournalSection, RecordingSection
from companion.config.web import LiveSection
from companion.desk.check import observers
from companion.desk.check.observers import check_live, check_recording
from companion.desk.check.rover import CheckedRover
from companion.system.side_process import missing_packages


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observers, "missing_for_recording", str)
    monkeypatch.setattr(observers, "missing_for_live", str)


def rover(
    folder: Path, *, size: int = 1, listen: str = "", running: Mapping[str, Any] | None = None
) -> CheckedRover:
    config = replace(
        Config(),
        journal=JournalSection(folder=str(folder)),
        recording=RecordingSection(size),
        live=LiveSection(listen),
    )
    return CheckedRover(config, "", folder, running)


def of_recordings(folder: Path, size: int, told: Mapping[str, Any] | None = None) -> tuple[str, str]:
    running = None if told is None else {"recording": told}
    (found,) = check_recording(rover(folder, size=size, running=running))
    return found.verdict.name, found.text


def of_the_live_view(listen: str, told: Mapping[str, Any] | None = None) -> tuple[str, str]:
    running = None if told is None else {"live": told}
    (found,) = check_live(rover(Path(), listen=listen, running=running))
    return found.verdict.name, found.text


def test_it_is_said_what_is_recorded_where_and_how_to_end_that(tmp_path: Path) -> None:
    verdict, text = of_recordings(tmp_path, 1)
    assert verdict == "PASS"
    assert text.startswith(
        f"records pictures, positions and the log into {tmp_path}/recordings: 1 MB at most, "
    )
    assert text.endswith(" MB are free; [recording] size = 0 ends it")
    told = {"trouble": "", "files": 3, "bytes": 5_000_000, "lost": 0}
    assert of_recordings(tmp_path, 20, told) == (
        "PASS",
        f"3 files, 5 MB of 20 MB in {tmp_path}/recordings; [recording] size = 0 ends it",
    )
    assert of_recordings(tmp_path, 0) == ("PASS", "off: [recording] size is 0")


def test_what_keeps_it_from_recording_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert of_recordings(tmp_path, 1_000_000)[0] == "WARN", "more than is free"
    assert of_recordings(tmp_path, 20, {"trouble": "the disk does not answer"}) == (
        "WARN",
        "the disk does not answer: nothing is recorded until that is mended",
    )
    told = {"trouble": "", "files": 3, "bytes": 5_000_000, "lost": 7}
    verdict, text = of_recordings(tmp_path, 20, told)
    assert (verdict, "7 messages lost" in text, "lower [recording] rate" in text) == ("WARN", True, True)
    absent = partial(missing_packages, {"nowhere": "mcap"}, "record")
    monkeypatch.setattr(observers, "missing_for_recording", absent)
    assert "pip install" in of_recordings(tmp_path, 20)[1]


def test_a_live_view_is_off_or_it_is_said_who_sees_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert of_the_live_view("") == ("PASS", 'off: [live] listen is ""')
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        assert of_the_live_view(listen)[0] == "WARN"
    assert of_the_live_view(listen) == (
        "PASS",
        f"{listen} is free, and will show it to programs on this computer",
    )
    verdict, text = of_the_live_view("0.0.0.0:0")
    assert (verdict, text.endswith("to whoever reaches that port: it has no password")) == ("WARN", True)
    told = {"url": "ws://127.0.0.1:8765/", "trouble": "", "clients": 1}
    assert of_the_live_view(listen, told)[1] == "ws://127.0.0.1:8765/ shows it to programs on this computer"
    assert of_the_live_view(listen, {"url": "", "trouble": "ended: SIGABRT"})[0] == "WARN"
    absent = partial(missing_packages, {"nowhere": "foxglove-sdk"}, "live")
    monkeypatch.setattr(observers, "missing_for_live", absent)
    assert 'pip install "anytraverse-companion[live]"' in of_the_live_view(listen)[1]
