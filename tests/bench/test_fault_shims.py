"""What the fault table's shims and checks do: a row whose fault is not produced would show nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench.faults.clocks import DAY, JumpingClock
from bench.faults.disk import FailingDisk
from bench.faults.mutated_configs import shipped, wrong_with
from bench.stopping.slow_disk import SlowDisk
from companion.config import reading

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler for the shim")


def said(shim: FailingDisk | SlowDisk | JumpingClock, program: str, *arguments: Path) -> list[str]:
    """The words that a Python program prints beside a shim."""
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        env={**os.environ, **shim.environment},
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    return done.stdout.split()


_CHANGES = """
import errno, os, sys
folder = sys.argv[1]

def tried(what):
    try:
        what()
    except OSError as error:
        return errno.errorcode[error.errno]
    return "done"

def overwrite():
    file = os.open(folder + "/old", os.O_RDWR)
    os.pwrite(file, b"new", 0)

def append():
    file = os.open(folder + "/old", os.O_WRONLY | os.O_APPEND)
    os.write(file, b"more")

print(
    tried(overwrite),
    tried(append),
    tried(lambda: os.close(os.open(folder + "/made", os.O_CREAT | os.O_WRONLY))),
    tried(lambda: os.rename(folder + "/made", folder + "/named")),
    tried(lambda: os.mkdir(folder + "/inner")),
    tried(lambda: open(folder + "/old", "rb").read()),
    tried(lambda: open(sys.argv[2] + "/outside", "wb").write(b"content")),
)
"""


@needs_compiler
@pytest.mark.parametrize(
    ("how", "becomes"),
    [
        ("full", "done ENOSPC done done done done done"),
        ("read-only", "EROFS EROFS EROFS EROFS EROFS done done"),
        ("", "done done done done done done done"),
    ],
)
def test_a_disk_that_fails_does_so_below_its_folder_only(tmp_path: Path, how: str, becomes: str) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "old").write_bytes(b"content")
    disk = FailingDisk(tmp_path, root)
    disk.set(how)
    assert said(disk, _CHANGES, root, tmp_path) == becomes.split()


_SYNCS = """
import os, sys, time
file = open(sys.argv[1], "wb")
for sync in (os.fsync, os.fdatasync):
    before = time.monotonic()
    sync(file.fileno())
    print(time.monotonic() - before)
"""


@needs_compiler
def test_each_sync_takes_as_much_longer_as_is_said_now(tmp_path: Path) -> None:
    disk = SlowDisk(tmp_path)
    disk.delay(0.2)
    assert all(float(took) >= 0.2 for took in said(disk, _SYNCS, tmp_path / "file"))
    disk.delay(0.0)
    assert min(map(float, said(disk, _SYNCS, tmp_path / "file"))) < 0.2


def test_without_a_compiler_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="install gcc"):
        SlowDisk(tmp_path)


_CLOCKS = "import time; print(time.time(), time.monotonic())"


@needs_compiler
def test_only_the_wall_clock_jumps(tmp_path: Path) -> None:
    clock, seen = JumpingClock(tmp_path), []
    for ahead in (0, DAY, -DAY):
        clock.set(ahead)
        seen.append([float(figure) for figure in said(clock, _CLOCKS)])
    (wall, steady), *later = seen
    assert [round((one - wall) / DAY) for one, _ in later] == [1, -1]
    assert all(0 < one - steady < 60 for _, one in later)


def test_a_setting_that_is_taken_but_not_in_force_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text(shipped().replace('"vehicles/rover.toml"', '""').replace("keep = 50", "keep = 51"))
    assert wrong_with(path) == (True, "")
    monkeypatch.setattr(reading, "_refuse_unknown", lambda *_: None)
    path.write_text("[pictures]\nkeep = 51\n[vehicle]\nfile = ''\n[nonsense]\nx = 1\n")
    with pytest.raises(AttributeError, match="nonsense"):
        wrong_with(path)
    path.write_text("[pictures]\nkeep = -1\n[vehicle]\nfile = ''\n")
    assert wrong_with(path) == (False, "")
