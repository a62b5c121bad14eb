"""What a loss of power leaves on a disk, and a short form of the bench that cuts it."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench.faults.disk_replay import SECTOR, Disk, DiskChange, read_record


def _disk(*changes: tuple[str, str, str, int, bytes]) -> Disk:
    disk = Disk("/root")
    for change in changes:
        disk.apply(DiskChange(*change, end=0))
    return disk


def test_what_was_not_synced_is_lost_and_the_program_sees_it_still() -> None:
    disk = _disk(("c", "/root/a", "", 0, b""), ("w", "/root/a", "", 0, b"content"))
    assert disk.now() == {"/root/a": b"content"}
    assert disk.content() == {}


def test_a_file_stays_when_it_and_its_folder_were_synced() -> None:
    made = [("c", "/root/a", "", 0, b""), ("w", "/root/a", "", 0, b"content")]
    assert _disk(*made, ("s", "/root/a", "", 0, b"")).content() == {}
    assert _disk(*made, ("s", "/root", "", 0, b"")).content() == {"/root/a": b""}
    both = [*made, ("s", "/root/a", "", 0, b""), ("s", "/root", "", 0, b"")]
    assert _disk(*both).content() == {"/root/a": b"content"}


def test_a_rename_without_sync_of_the_content_may_leave_an_empty_file() -> None:
    disk = _disk(
        ("c", "/root/.part", "", 0, b""),
        ("w", "/root/.part", "", 0, b"content"),
        ("r", "/root/.part", "/root/a", 0, b""),
    )
    left = [disk.content(random.Random(seed)).get("/root/a") for seed in range(50)]
    assert {None, b"", b"content"} == set(left)


def test_a_write_is_torn_only_between_sectors() -> None:
    data = bytes([1]) * SECTOR + bytes([2]) * SECTOR
    disk = _disk(
        ("c", "/root/a", "", 0, b""),
        ("s", "/root/a", "", 0, b""),
        ("s", "/root", "", 0, b""),
        ("w", "/root/a", "", 0, data),
    )
    left = {disk.content(random.Random(seed))["/root/a"] for seed in range(50)}
    assert left == {b"", data[:SECTOR], bytes(SECTOR) + data[SECTOR:], data}


def test_a_torn_last_record_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "record"
    whole = b"u" + (5).to_bytes(2, "little") + bytes(14) + b"/root"
    path.write_bytes(whole + whole[:-1])
    assert [change.path for change in read_record(path)] == ["/root"]


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler for the shim")
def test_no_kill_and_no_loss_of_power_loses_what_an_operator_was_told() -> None:
    command = [sys.executable, "-m", "bench.faults.power_loss", "--kills", "8", "--cuts", "25"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["killed"]["kills"] == 8
    assert figures["cut"]["cuts"] == 25
