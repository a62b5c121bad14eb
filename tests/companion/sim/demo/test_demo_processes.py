"""What the demo starts and writes: children, configuration, and a rehearsal on pictures of one's own."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from companion.config import load_config
from companion.sim.demo import stage as module
from companion.sim.demo.child import ChildError, LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.rehearsal import run_camera_demo
from companion.sim.demo.sheet import write_sheet
from companion.sim.demo.stage import set_stage
from companion.sim.demo.story import Story
from tests.waiting import is_gone, wait_for


@pytest.mark.parametrize("name", ["plain", 'with "quotes" and \\ and ä'])
@pytest.mark.parametrize("policy", ["hold", "shadow"])
def test_the_written_configuration_loads(tmp_path: Path, name: str, policy: str) -> None:
    out = tmp_path / name
    out.mkdir()
    path = write_config(out, camera=f"folder:{out}", link="udpout:127.0.0.1:14550", policy=policy)
    config = load_config(str(path))
    assert (config.camera.source, config.call.policy) == (f"folder:{out}", policy)
    assert config.journal.path == out / "state"
    assert config.preferences.format() == "grass: 1; dirt path: 1; bush: -1; tree: -1; sky: -1"


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module that a child can run."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path / "part.py"


def test_a_child_is_read_typed_to_and_stopped(script: Path, tmp_path: Path) -> None:
    script.write_text("print('ready', flush=True)\nprint(input().upper(), flush=True)\ninput()\n")
    child = LoggedProcess("part", ["part"], tmp_path / "part.log")
    assert child.first_line(10.0) == "ready"
    child.type("hello")
    assert child.first_line(10.0) == "HELLO"
    child.stop()
    assert not child.running
    child.type("nobody hears this")


def test_a_child_that_fails_says_where_to_look(script: Path, tmp_path: Path) -> None:
    script.write_text("raise SystemExit('no such trail')\n")
    child = LoggedProcess("part", ["part"], tmp_path / "part.log")
    with pytest.raises(ChildError, match=r"part did not start: see .*part\.log"):
        child.first_line(10.0)
    child.stop()
    assert "no such trail" in (tmp_path / "part.log").read_text()


def test_a_child_that_does_not_end_is_killed(script: Path, tmp_path: Path) -> None:
    script.write_text(
        "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\n"
        "time.sleep(60)\n"
    )
    child = LoggedProcess("part", ["part"], tmp_path / "part.log")
    child.first_line(10.0)
    child.stop(timeout=0.2)
    assert not child.running


def test_a_child_that_was_stopped_does_not_outlive_a_parent_that_was_killed(
    script: Path, tmp_path: Path
) -> None:
    script.write_text(
        "import signal, time\nsignal.signal(signal.SIGTERM, lambda *_: None)\nprint('up', flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = (
        "import signal, sys, time\nfrom pathlib import Path\n"
        "from companion.sim.demo.child import LoggedProcess\n"
        "child = LoggedProcess('part', ['part'], Path(sys.argv[1]), orphaned=signal.SIGKILL)\n"
        "child.first_line(10.0)\nchild.process.send_signal(signal.SIGSTOP)\n"
        "print(child.process.pid, flush=True)\ntime.sleep(60)\n"
    )
    killed = subprocess.Popen(
        [sys.executable, "-c", parent, str(tmp_path / "part.log")], stdout=subprocess.PIPE, text=True
    )
    assert killed.stdout is not None
    orphan = int(killed.stdout.readline())
    killed.kill()
    killed.wait(10.0)
    wait_for(lambda: is_gone(orphan))


def test_a_stage_that_cannot_be_set_ends_what_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[LoggedProcess] = []

    class Recorded(LoggedProcess):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    def refused(*_: object) -> None:
        raise OSError("no control")

    monkeypatch.setattr(module, "LoggedProcess", Recorded)
    monkeypatch.setattr("companion.sim.demo.operator.LoggedProcess", Recorded)
    monkeypatch.setattr(module, "FieldControl", refused)
    with pytest.raises(OSError, match="no control"):
        set_stage(tmp_path, seed=1, auto=True)
    assert [child.name for child in started] == ["field", "daemon", "operator"]
    assert not any(child.running for child in started)


def test_a_rehearsal_judges_a_folder_of_pictures_and_draws_a_sheet(tmp_path: Path) -> None:
    pictures = tmp_path / "drive"
    pictures.mkdir()
    random = np.random.default_rng(1)
    for number in range(25):
        image = np.full((120, 160, 3), (60, 140, 90), dtype=np.uint8)
        image[:50] = (235, 190, 140)
        if number >= 10:
            image[60:110, 55:105] = (200, 30, 220)
        image = np.clip(image + random.integers(-12, 12, image.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(pictures / f"{number:03d}.png"), image)
    out, stream = tmp_path / "out", io.StringIO()
    out.mkdir()
    assert run_camera_demo(f"folder:{pictures}", out, Story(stream), auto=True) == 0
    figures = json.loads(stream.getvalue().splitlines()[-1])
    assert figures["frames"] >= 3  # a busy machine misses most of them
    assert figures["calls"] >= 1
    assert Path(figures["contact_sheet"]).is_file()


def test_a_rehearsal_without_pictures_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(ChildError, match=r"no frame came: .*holds no picture"):
        run_camera_demo(f"folder:{tmp_path}", tmp_path, Story(io.StringIO()), auto=True)


def test_a_sheet_shows_each_call_as_it_was_seen_beside_its_judgement(tmp_path: Path) -> None:
    for folder in ("pictures", "calls"):
        (tmp_path / "state" / folder).mkdir(parents=True)
    names = ("00001-c7-unknown-thing", "00002-c7-answered", "00003-c7-drives-on", "00004-known-place-again")
    for level, name in zip((60, 90, 100, 120), names, strict=True):
        tile = np.full((34 + 36 + 30, 48, 3), level, np.uint8)
        cv2.imwrite(str(tmp_path / "state" / "pictures" / f"{name}.jpg"), tile)
    cv2.imwrite(str(tmp_path / "state" / "calls" / "7-raw.jpg"), np.full((36, 48, 3), 200, np.uint8))
    path = write_sheet(tmp_path)
    assert path is not None
    sheet = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert sheet is not None
    assert sheet[56 + 52 :: 116, 16 + 24 :: 64].tolist() == [[200, 60, 120, 255]]


def test_without_pictures_there_is_no_sheet(tmp_path: Path) -> None:
    assert write_sheet(tmp_path) is None
