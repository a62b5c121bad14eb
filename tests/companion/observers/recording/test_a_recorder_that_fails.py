"""Whatever happens to the recording process or its disk: the supervisor does not wait, and it goes on."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from companion.config import Config
from companion.observers.live.live import Live
from companion.observers.recording import process as process_module
from companion.observers.recording import recorder as recorder_module
from companion.observers.recording.messages import RecordedMessage, RecordingReport
from companion.observers.recording.process import Writing
from companion.observers.recording.reading import messages, whole
from companion.observers.recording.recorder import RecorderChild
from companion.observers.recording.ring_writer import RingWriter
from companion.system.side_process import missing_packages
from companion.system.watchdog import Restarts
from tests.companion.observers.recording.made import Stage, frame, opened, status
from tests.waiting import wait_for

SLOWEST_TURN = 0.25
"""Seconds. A turn starts a process at most, on a loaded computer."""
SAYS = "import socket, sys, time; s = socket.socket(fileno=int(sys.argv[3])); {}; time.sleep(30)"


def numbers(stage: Stage) -> list[int]:
    """The frames that were recorded, in the order of the files."""
    found = [one for path in stage.files for one in messages(path, {"/camera"})]
    return [one.message.sequence for one in found]


def test_what_is_sent_is_recorded_and_the_file_is_whole_after_an_orderly_end(tmp_path: Path) -> None:
    stage = Stage(tmp_path).ready()
    large = frame(3, 3.0, 900_000)  # more than the channel takes at once
    for message in (status(1), frame(2, 2.0), large, opened(4, 4.0)):
        stage.turn([message])
    stage.until(lambda: stage.recorder.figures()["written"] == 4)
    stage.recorder.close()
    (path,) = stage.files
    assert path.name == "000001-event.mcap"
    assert whole(path)
    assert [one.message.data for one in messages(path, {"/camera"})][1] == large.data
    assert stage.recorder.figures()["lost"] == 0


@pytest.mark.parametrize("deed", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_dies_or_hangs_is_started_again_and_nobody_waits(
    tmp_path: Path, deed: signal.Signals
) -> None:
    stage = Stage(tmp_path).ready()
    first, slowest, count = stage.pid(), 0.0, 0
    stage.turn([frame(0, 0.0)])
    stage.until(lambda: stage.files and stage.files[0].stat().st_size > 20_000)  # it was flushed
    os.kill(first, deed)
    deadline = time.monotonic() + 20.0
    while stage.pid() in (0, first) or not stage.recorder.running:
        assert time.monotonic() < deadline
        count += 1
        slowest = max(slowest, stage.turn([frame(count, count / 100)]))
    assert slowest < SLOWEST_TURN
    stage.turn([frame(99_999, 200.0)])
    stage.until(lambda: stage.recorder.figures()["restarts"] == 1 and not stage.recorder._waiting)
    stage.recorder.close()
    assert {0, 99_999} <= set(numbers(stage)), "what was flushed before, and what came after"
    assert all(whole(path) for path in stage.files), "the torn one was repaired"
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


def test_a_stopped_process_takes_nothing_and_what_is_lost_is_counted(tmp_path: Path) -> None:
    stage = Stage(tmp_path, restarts=Restarts(60.0, 60.0, 1.0, 1.0)).ready()
    os.kill(stage.pid(), signal.SIGSTOP)
    began = time.monotonic()
    for number in range(150):
        stage.recorder.feed([frame(number, 0.0, 100_000)], time.monotonic())
    assert time.monotonic() - began < 1.0
    lost = stage.recorder.figures()["lost"]
    assert 40 < lost < 90, "what waits is bounded"
    os.kill(stage.pid(), signal.SIGCONT)
    stage.until(lambda: stage.recorder.figures()["written"] + lost >= 150)
    stage.recorder.close()
    assert numbers(stage) == list(range(150 - lost)), "whole ones, in order"


@pytest.mark.parametrize("said", ["s.send(b'x')", "s.send(bytes(300))", "s.send(bytes(28) + b'\\0')"])
def test_a_process_that_says_nonsense_is_killed(
    tmp_path: Path, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    command = (sys.executable, "-c", SAYS.format(said))
    stage = Stage(tmp_path, launch=lambda folder, most: RecorderChild(folder, most, command))
    stage.until(lambda: stage.recorder.figures()["restarts"] >= 1)
    stage.recorder.close()
    assert "the recorder sent nonsense; it is started again in 0 s" in caplog.text


def test_a_disk_that_hangs_costs_messages_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_module, "MOST_WAITING", 105_000)
    goes_on = threading.Event()

    class Hanging(RingWriter):
        def begin(self, now: float) -> None:  # noqa: ARG002
            goes_on.wait(10.0)

        def write(self, message: RecordedMessage, now: float) -> None:  # noqa: ARG002
            self._written += 1
            self._tell()

    writing = Writing(Hanging(Path("nowhere"), 1))
    writing.start()
    for number in range(20):
        writing.put(frame(number, 0.0, 10_000))
    report = writing.report(time.monotonic() + 7.0)
    assert report.trouble == "the disk does not answer"
    assert report.lost == 11
    goes_on.set()
    wait_for(lambda: writing.report(time.monotonic()).written >= 9, 5.0)
    writing.finish()
    assert writing.report(time.monotonic() + 7.0) == RecordingReport(0, 0, 9, 11, "")


def test_a_full_disk_is_told_once_by_the_log_and_in_the_status(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "recordings").write_text("in the way")
    stage = Stage(tmp_path).ready()
    stage.until(lambda: stage.recorder.figures()["trouble"] != "")
    for number in range(30):
        stage.turn([status(number)])
    stage.until(lambda: stage.recorder.figures()["lost"] == 30)
    assert stage.recorder.figures()["trouble"] == "file exists"
    assert stage.recorder.figures()["restarts"] == 0
    stage.recorder.close()
    said = [one for one in caplog.records if "file exists" in one.getMessage()]
    assert len(said) == 1


def test_without_the_package_it_is_said_once_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(recorder_module, "missing", lambda: missing_packages({"nowhere": "mcap"}, "record"))
    stage = Stage(tmp_path)
    for _ in range(5):
        stage.turn([status(1)])
    assert stage.pid() == 0
    assert stage.recorder.listener == 0
    (record,) = caplog.records
    assert 'pip install "anytraverse-companion[record]"' in record.getMessage()
    assert stage.recorder.trouble.startswith("mcap not installed")


def test_a_size_of_zero_means_no_process(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    stage = Stage(tmp_path, size=0)
    stage.turn([status(1)])
    assert (stage.pid(), caplog.records, stage.files) == (0, [], [])
    assert stage.recorder.figures() == {
        "on": False,
        "trouble": "switched off by [recording] size",
        "restarts": 0,
        "files": 0,
        "bytes": 0,
        "written": 0,
        "lost": 0,
    }


def test_what_waits_for_a_process_that_dies_is_counted_as_lost(tmp_path: Path) -> None:
    stage = Stage(tmp_path).ready()
    first = stage.pid()
    os.kill(first, signal.SIGSTOP)
    for number in range(40):
        stage.turn([frame(number, 0.0, 100_000)])
    os.kill(first, signal.SIGKILL)
    stage.until(lambda: stage.recorder.figures()["restarts"] == 1)
    stage.until(lambda: stage.recorder.figures()["lost"] > 20)
    stage.recorder.close()


def test_each_metric_of_recorder_and_live_view_is_told(tmp_path: Path) -> None:
    metrics = pytest.importorskip("companion.observers.page.metrics")
    told = {
        "recording": {**Stage(tmp_path).recorder.figures(), "left_out": 0},
        "live": Live(Config()).figures(),
    }
    paths = [figure.path.split(".") for figure in metrics.FIGURES]
    ours = [path for path in paths if path[0] in told]
    assert len(ours) == 10
    assert all(isinstance(told[part][name], (bool, int)) for part, name in ours)


def test_a_message_that_is_too_long_is_lost_alone(tmp_path: Path) -> None:
    stage = Stage(tmp_path).ready()
    stage.turn([frame(1, 0.0, 6 << 20), frame(2, 0.0)])
    stage.until(lambda: stage.recorder.figures()["written"] == 1)
    assert stage.recorder.figures()["lost"] == 1
    stage.recorder.close()
    assert numbers(stage) == [2]
