"""A whole companion that records: what mcap's own reader finds fits what happened, whatever is killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mcap")

from mcap.reader import NonSeekingReader, make_reader

from anytraverse.perception import KINDS
from bench.processes import children
from companion.cli import main
from companion.observers.recording.reading import whole
from tests.companion.daemon.painted_drive import to_a_drum
from tests.companion.vision.test_processes import ROOT, SCRIPT, is_gone

PATIENCE = 20.0
PAINTED = ("tests.companion.vision.painted", "Obedient")


class Companion:
    """`companion run` with painted eyes, and a recorder."""

    def __init__(self, folder: Path, port: int) -> None:
        self.state = folder / "state"
        self.config = to_a_drum(folder, port, recorded=20)
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(self.config)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=subprocess.DEVNULL,
        )

    def told(self) -> dict[str, Any]:
        with suppress(OSError, ValueError):
            return dict(json.loads((self.state / "status.json").read_text()))
        return {}

    def recorded(self) -> int:
        return int(self.told().get("recording", {}).get("written", 0))

    def recorder(self) -> int:
        """The process id of the recorder, 0 without one."""
        found = children(self.process.pid).items()
        return next((child for child, command in found if "companion.observers.recording" in command), 0)

    def files(self) -> list[Path]:
        return sorted((self.state / "recordings").glob("*.mcap"))

    def until(self, fits: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not fits():
            assert time.monotonic() < deadline, self.told()
            time.sleep(0.05)


@pytest.fixture
def companion(tmp_path: Path) -> Iterator[Companion]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        running = Companion(tmp_path, ground.getsockname()[1])
        try:
            yield running
        finally:
            running.process.kill()
            running.process.wait()


def counted(path: Path) -> Counter[str]:
    with path.open("rb") as file:
        reader = make_reader(file) if whole(path) else NonSeekingReader(file)
        found = Counter[str]()
        with suppress(Exception if not whole(path) else AssertionError):  # a torn end
            for _, channel, _ in reader.iter_messages(log_time_order=False):
                found[channel.topic] += 1
        return found


def test_what_is_recorded_fits_what_happened_and_a_killed_recorder_harms_nothing(
    companion: Companion, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    companion.until(lambda: companion.told().get("current_id") and companion.recorded() > 40)
    first, frames = companion.recorder(), companion.told()["frames"]
    companion.until(lambda: companion.files()[0].stat().st_size > 10_000)
    os.kill(first, signal.SIGKILL)
    companion.until(lambda: companion.recorder() not in (0, first) and len(companion.files()) > 1)
    companion.until(lambda: companion.told().get("recording", {}).get("restarts") == 1)
    companion.until(lambda: companion.told().get("frames", 0) > frames)
    assert companion.told()["vision"] == {"trouble": "", "restarts": 0}
    monkeypatch.setitem(KINDS, "painted", PAINTED)
    monkeypatch.chdir(tmp_path)
    assert main(["incident", "C1", "--config", str(companion.config)]) == 0, "while it runs"
    companion.process.send_signal(signal.SIGTERM)
    companion.process.wait(10.0)
    assert all(whole(path) for path in companion.files())
    found = sum((counted(path) for path in companion.files()), Counter[str]())
    last = companion.told()
    assert found["/decisions"] >= 1
    maps, boxes = found["/maps/uncertainty"], found["/camera/annotations"]
    assert 5 <= boxes <= maps <= found["/camera"] <= boxes + 1, "a chunk that was lost may begin with maps"
    assert found["/camera"] < found["/assessment"] <= last["frames"]
    assert found["/setup"] == found["/words"] == 2, "each recording begins with what holds"
    with companion.files()[-1].open("rb") as file:
        judged = [json.loads(one[2].data) for one in make_reader(file).iter_messages(["/assessment"])]
    numbers = [one["frame"] for one in judged]
    assert numbers == sorted(set(numbers))
    assert all(one["reasons"] == ["unknown_object"] for one in judged if not one["ok"])
    with zipfile.ZipFile(tmp_path / "incident-C1.zip") as packed:
        assert {"recording.mcap", "calls/1.json", "calls/1.jpg"} <= set(packed.namelist())
    assert "recordings" not in capsys.readouterr().err


def test_with_its_companion_killed_a_recorder_is_gone_and_its_torn_file_is_read(
    companion: Companion, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    companion.until(lambda: companion.told().get("current_id") and companion.recorded() > 40)
    companion.until(lambda: companion.files()[0].stat().st_size > 10_000)
    recorder = companion.recorder()
    os.kill(recorder, signal.SIGSTOP)  # else it may finish its file before the kernel ends it
    companion.process.send_signal(signal.SIGKILL)
    companion.process.wait()
    companion.until(lambda: is_gone(recorder))
    (path,) = companion.files()
    assert not whole(path)
    assert counted(path)["/assessment"] > 5, "mcap's own reader reads it, too"
    monkeypatch.setitem(KINDS, "painted", PAINTED)
    monkeypatch.chdir(tmp_path)
    assert main(["incident", "--last", "60s", "--config", str(companion.config)]) == 0
    companion.start()
    companion.until(lambda: whole(path))
