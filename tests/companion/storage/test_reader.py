"""The thread that reads served files: who asks never waits, and learns in two seconds that a disk hangs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from companion.storage.file_reader import MOST, PATIENCE, FileReader
from companion.storage.served_files import MatchingFiles
from companion.storage.served_tree import FileError, LaterError, MissingError, Tree

REAL = 10.0


class Disk:
    """Reads wait for `released`."""

    def __init__(self) -> None:
        self.entered, self.released = threading.Event(), threading.Event()
        self.reads = 0

    def read(self) -> bytes:
        self.reads += 1
        self.entered.set()
        assert self.released.wait(REAL)
        return b"content"


def patiently(ask: Callable[[], Any]) -> Any:
    """Until it is there."""
    for _ in range(int(REAL / 0.005)):
        with suppress(LaterError):
            return ask()
        time.sleep(0.005)
    raise AssertionError("it never came")


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [1000.0]
    monkeypatch.setattr("companion.storage.file_reader.time.monotonic", lambda: now[0])
    return now


def test_without_a_thread_it_is_read_at_once() -> None:
    assert FileReader().read("a", lambda: 1) == 1
    with pytest.raises(MissingError):
        Tree({"logs": MatchingFiles(Path("/nowhere"))}).open("/logs/a")


def test_who_asks_a_disk_that_hangs_never_waits_and_is_told_after_two_seconds(now: list[float]) -> None:
    disk = Disk()
    with FileReader() as reader:
        before = time.perf_counter()
        for now[0] in (1000.0, 1000.0 + PATIENCE - 0.01):
            with pytest.raises(LaterError):
                reader.read("a", disk.read)
        now[0] = 1000.0 + PATIENCE
        with pytest.raises(FileError, match="the disk hangs"):
            reader.read("a", disk.read)
        assert time.perf_counter() - before < 1.0
        disk.released.set()
        assert patiently(lambda: reader.read("a", disk.read)) == b"content"


def test_no_more_than_a_few_reads_wait_and_those_that_nobody_asks_for_go(now: list[float]) -> None:
    disk = Disk()
    with FileReader() as reader:
        for number in range(MOST):
            with pytest.raises(LaterError):
                reader.read(number, disk.read)
        with pytest.raises(FileError, match="too much waits"):
            reader.read(MOST, disk.read)
        assert disk.entered.wait(REAL)
        now[0] += 2 * PATIENCE
        with pytest.raises(LaterError):
            reader.read(MOST, disk.read)
        disk.released.set()
        assert patiently(lambda: reader.read(MOST, disk.read)) == b"content"
        assert disk.reads == 2, "what nobody waits for is not read"


def test_an_error_of_a_read_is_told_to_who_asked_and_costs_no_other(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_bytes(b"first")
    with FileReader() as reader:
        tree = Tree({"logs": MatchingFiles(tmp_path, "*.log", reader)})
        for mistake in (ZeroDivisionError("odd"), MissingError("a")):

            def fail(error: Exception = mistake) -> None:
                raise error

            with pytest.raises(FileError, match=str(mistake)):
                patiently(partial(reader.read, "x", fail))
        with pytest.raises(MissingError):
            patiently(lambda: tree.open("/logs/b.log"))
        assert patiently(lambda: tree.open("/logs/a.log")).read(0, 9) == b"first"
        assert [entry.name for entry in patiently(lambda: tree.entries("/logs"))] == ["a.log"]
