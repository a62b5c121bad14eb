"""The shim that makes a disk slow for one process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench.stopping.slow_disk import SlowDisk

_SYNCS = """
import os, sys, time
file = open(sys.argv[1], "wb")
for sync in (os.fsync, os.fdatasync):
    before = time.monotonic()
    sync(file.fileno())
    print(time.monotonic() - before)
"""

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


def seconds(disk: SlowDisk, folder: Path) -> list[float]:
    """What fsync and fdatasync take."""
    done = subprocess.run(
        [sys.executable, "-c", _SYNCS, str(folder / "file")],
        env={**os.environ, **disk.environment},
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    return [float(line) for line in done.stdout.split()]


@needs_compiler
def test_each_sync_takes_as_much_longer_as_is_said_now(tmp_path: Path) -> None:
    disk = SlowDisk(tmp_path)
    disk.delay(0.2)
    assert all(took >= 0.2 for took in seconds(disk, tmp_path))
    disk.delay(0.0)
    assert min(seconds(disk, tmp_path)) < 0.2


def test_without_a_compiler_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="install gcc"):
        SlowDisk(tmp_path)
