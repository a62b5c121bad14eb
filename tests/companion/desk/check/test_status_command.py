"""`companion status`: who runs, whether it is well, and with which exit code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from companion.desk.check import running
from companion.desk.check.here import RUNNING, status

WELL: dict[str, Any] = {
    "state": "ok",
    "reasons": [],
    "current_id": 0,
    "policy": "hold",
    "hold_refused": "",
    "words": "grass: 1",
    "perceiver": {"model": "builtin/1", "step_ms": 41.0},
    "camera": {"state": "delivering", "reason": "", "read": 120, "dropped": 3},
    "link": {"trouble": None, "autopilot": "main"},
    "computer": {"temperature": 61.2, "throttled": True, "cpu": 0.43, "memory": 1994, "memory_free": 512},
    "frames": 100,
}


class Folder:
    """A configuration, and what stands in its status file."""

    def __init__(self, path: Path) -> None:
        (path / "state").mkdir()
        self.config = path / "companion.toml"
        self.config.write_text('[vehicle]\nfile = ""\n[journal]\nfolder = "state"\n')
        self.file = path / "state" / "status.json"

    def says(self, pid: int | None = None, age: float = 0.0, **said: Any) -> None:
        self.file.write_text(json.dumps({**WELL, "pid": pid or os.getpid(), **said}))
        at = time.time() - age
        os.utime(self.file, (at, at))

    def asked(self) -> int:
        return main(["status", str(self.config)])


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


@pytest.fixture
def ended() -> int:
    """The number of a process that is gone."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait(10.0)
    return process.pid


def test_a_companion_that_is_well_says_what_it_does(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.says(current_id=7, state="calling", reasons=["unknown_object"])
    assert folder.asked() == running.WELL == 0
    told = capsys.readouterr().out
    assert told.startswith(f"the companion runs, process {os.getpid()}\n")
    for row in (
        "state       calling: unknown_object",
        "policy      hold\n",
        "open        call or hold 7",
        "camera      delivering, 120 frames read, 100 judged",
        "perceiver   builtin/1, 41.0 ms a frame",
        "vision      running\n",
        "link        autopilot on main",
        "computer    61 C, slowed down, CPU 43 %, 512 of 1994 MiB memory free\n",
        "words       grass: 1",
    ):
        assert row in told
    assert "MiB free" in told
    assert "\nsince " in told


@pytest.mark.parametrize(
    ("guide", "told"),
    [
        ({"state": "guiding", "lacks": None}, "guide       guiding\n"),
        ({"state": "off", "lacks": "no ArduPilot rover"}, "guide       off: no ArduPilot rover\n"),
    ],
)
def test_in_policy_guide_it_says_whether_it_drives_and_what_it_lacks(
    folder: Folder, capsys: pytest.CaptureFixture[str], guide: dict[str, Any], told: str
) -> None:
    folder.says(policy="guide", guide=guide)
    folder.asked()
    assert told in capsys.readouterr().out
    folder.says(guide={"state": "off", "lacks": "policy is not guide"})
    folder.asked()
    assert "\nguide " not in capsys.readouterr().out


def test_one_that_judges_less_often_than_configured_says_why(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.says(judging={"rate": 7.5, "configured": 10.0, "lowered_by": "hot computer"})
    assert folder.asked() == 0
    assert "builtin/1, 41.0 ms a frame, 7.5 frames/s of 10.0: hot computer\n" in capsys.readouterr().out


def test_a_camera_that_shows_infrared_is_told(folder: Folder, capsys: pytest.CaptureFixture[str]) -> None:
    folder.says(camera={"state": "delivering", "infrared": True})
    folder.asked()
    assert "shows infrared (NoIR)" in capsys.readouterr().out
    folder.says(camera={"state": "delivering", "infrared": False})
    folder.asked()
    assert "infrared" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"state": "fault", "reasons": ["fault"]}, "cannot judge: FAULT"),
        ({"link": {"trouble": "serial: gone"}}, "its link fails"),
        ({"state": "fault", "camera": {"state": "failed", "reason": "no cable"}}, "failed: no cable"),
        (
            {"state": "fault", "vision": {"trouble": "vision hangs", "restarts": 2}},
            "vision hangs, started again 2 x",
        ),
        ({"state": "fault", "disk": {"failing": True}}, "not written now; "),
    ],
)
def test_a_faulty_one_ends_with_1(
    folder: Folder, capsys: pytest.CaptureFixture[str], said: dict[str, Any], told: str
) -> None:
    folder.says(**said)
    assert folder.asked() == 1
    assert told in capsys.readouterr().out


def test_one_that_writes_nothing_any_more_hangs(folder: Folder, capsys: pytest.CaptureFixture[str]) -> None:
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        folder.says(process.pid)
        at = time.time()
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(running, "started_at", lambda _: at - 60.0)
            patched.setattr(time, "time", lambda: at + RUNNING + 3.0)
            assert folder.asked() == 1
    finally:
        process.communicate(b"\n", timeout=10.0)
    assert "has written no status for" in capsys.readouterr().out


def test_where_none_was_ever_started_it_ends_with_2(
    folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert folder.asked() == 2
    assert "no companion runs" in capsys.readouterr().out


@pytest.mark.parametrize(("left", "told"), [({"recent": []}, "was stopped"), ({}, "died")])
def test_one_that_is_gone_is_told_with_how_it_went(
    folder: Folder, ended: int, capsys: pytest.CaptureFixture[str], left: dict[str, Any], told: str
) -> None:
    folder.says(ended, age=300.0, **left)
    assert folder.asked() == 2
    assert f"process {ended} {told} 5 min ago" in capsys.readouterr().out


def test_another_process_that_got_its_number_later_is_not_it(folder: Folder) -> None:
    folder.says(os.getpid(), age=86400.0)
    assert folder.asked() == 2


@pytest.mark.parametrize("content", ["{", "[]", "null", '{"camera": 3, "link": [], "reasons": null}'])
def test_a_status_file_of_another_shape_breaks_nothing(folder: Folder, content: str) -> None:
    folder.file.write_text(content)
    assert folder.asked() in (0, 2)


def test_programs_read_its_last_line(folder: Folder, capsys: pytest.CaptureFixture[str]) -> None:
    folder.says()
    assert main(["status", "--json", str(folder.config)]) == 0
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (said["code"], said["status"]["policy"]) == (0, "hold")
    assert 0.0 <= said["age"] < 5.0


def test_a_wrong_configuration_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", str(tmp_path / "none.toml")]) == 2
    assert "companion init" in capsys.readouterr().out


def test_a_status_file_that_is_none_is_neither_waited_for_nor_believed(folder: Folder) -> None:
    os.mkfifo(folder.file)
    assert folder.asked() == running.NOT_RUNNING
    assert status(folder.file.parent) is None
    folder.file.unlink()
    for content in ("[]", "[" * 100_000, "{"):
        folder.file.write_text(content)
        assert folder.asked() == running.NOT_RUNNING
        assert status(folder.file.parent) is None
