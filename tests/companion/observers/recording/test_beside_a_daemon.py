"""A whole companion that records: what mcap's own reader finds fits what happened, whatever is killed."""

from __future__ import annotations

import json
import os
import signal
import zipfile
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from mcap.reader import NonSeekingReader, make_reader

from anytraverse.perception import KINDS
from companion.cli import main
from companion.observers.recording.reading import whole
from tests.companion.processes import Companion
from tests.waiting import is_gone

RECORDER = "companion.observers.recording"
PAINTED = ("tests.companion.vision.painted", "Obedient")


@pytest.fixture
def companion(tmp_path: Path) -> Iterator[Companion]:
    with closing(Companion(tmp_path, recorded="20")) as running:
        yield running


def recorded(companion: Companion) -> int:
    return int(companion.told().get("recording", {}).get("written", 0))


def files(companion: Companion) -> list[Path]:
    return sorted((companion.state / "recordings").glob("*.mcap"))


def counted(path: Path) -> Counter[str]:
    with path.open("rb") as file:
        reader = make_reader(file) if whole(path) else NonSeekingReader(file)
        found = Counter[str]()
        with suppress(Exception if not whole(path) else AssertionError):  # a torn end
            for _, channel, _ in reader.iter_messages(log_time_order=False):
                found[channel.topic] += 1
        return found


@pytest.mark.slow
def test_what_is_recorded_fits_what_happened_and_a_killed_recorder_harms_nothing(
    companion: Companion, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    companion.until(lambda: companion.told().get("current_id") and recorded(companion) > 40)
    first, frames = companion.child(RECORDER), companion.told()["frames"]
    companion.until(lambda: files(companion)[0].stat().st_size > 10_000)
    os.kill(first, signal.SIGKILL)
    companion.until(lambda: companion.child(RECORDER) not in (0, first) and len(files(companion)) > 1)
    companion.until(lambda: companion.told().get("recording", {}).get("restarts") == 1)
    companion.until(lambda: companion.told().get("frames", 0) > frames)
    assert companion.told()["vision"] == {"trouble": "", "restarts": 0}
    monkeypatch.setitem(KINDS, "painted", PAINTED)
    monkeypatch.chdir(tmp_path)
    assert main(["incident", "C1", "--config", str(companion.config)]) == 0, "while it runs"
    companion.process.send_signal(signal.SIGTERM)
    companion.process.wait(10.0)
    assert all(whole(path) for path in files(companion))
    found = sum((counted(path) for path in files(companion)), Counter[str]())
    last = companion.told()
    assert found["/decisions"] >= 1
    maps, boxes = found["/maps/uncertainty"], found["/camera/annotations"]
    assert 5 <= boxes <= maps <= found["/camera"] <= boxes + 1, "a chunk that was lost may begin with maps"
    assert found["/camera"] < found["/assessment"] <= last["frames"]
    assert found["/setup"] == found["/words"] == 2, "each recording begins with what holds"
    with files(companion)[-1].open("rb") as file:
        judged = [json.loads(one[2].data) for one in make_reader(file).iter_messages(["/assessment"])]
    numbers = [one["frame"] for one in judged]
    assert numbers == sorted(set(numbers))
    assert all(one["reasons"] == ["unknown_object"] for one in judged if not one["ok"])
    with zipfile.ZipFile(tmp_path / "incident-C1.zip") as packed:
        assert {"recording.mcap", "calls/1.json", "calls/1.jpg"} <= set(packed.namelist())
    assert "recordings" not in capsys.readouterr().err


@pytest.mark.slow
def test_with_its_companion_killed_a_recorder_is_gone_and_its_torn_file_is_read(
    companion: Companion, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    companion.until(lambda: companion.told().get("current_id") and recorded(companion) > 40)
    companion.until(lambda: files(companion)[0].stat().st_size > 10_000)
    recorder = companion.child(RECORDER)
    os.kill(recorder, signal.SIGSTOP)  # else it may finish its file before the kernel ends it
    companion.process.send_signal(signal.SIGKILL)
    companion.process.wait()
    companion.until(lambda: is_gone(recorder))
    (path,) = files(companion)
    assert not whole(path)
    assert counted(path)["/assessment"] > 5, "mcap's own reader reads it, too"
    monkeypatch.setitem(KINDS, "painted", PAINTED)
    monkeypatch.chdir(tmp_path)
    assert main(["incident", "--last", "60s", "--config", str(companion.config)]) == 0
    companion.start()
    companion.until(lambda: whole(path))
