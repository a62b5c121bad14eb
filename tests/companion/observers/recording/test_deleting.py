"""Recordings are deleted on request, one after the other, and never the one that is being written."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from companion.config import Config
from companion.config.schema import JournalSection
from companion.observers.recording.deleting import MOST_WAITING, RecordingDeleter
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.ring import FOLDER
from companion.wire.ids import Result
from tests.companion.observers.recording.made import status
from tests.waiting import wait_for


class Deleting:
    """A deleter, and what was told."""

    def __init__(self, folder: Path) -> None:
        self.home = folder / FOLDER
        self.home.mkdir()
        self.told: list[tuple[Result, str]] = []
        self.deleter = RecordingDeleter(replace(Config(), journal=JournalSection(folder=str(folder))))

    def ask(self, number: int) -> None:
        self.deleter.ask(number, lambda result, text: self.told.append((result, text)))

    def became(self, count: int = 1) -> list[tuple[Result, str]]:
        def done() -> bool:
            self.deleter.poll()
            return len(self.told) >= count

        wait_for(done, 20.0)
        return self.told

    def recording(self, name: str) -> McapFile:
        file = McapFile(self.home / name, 1 << 22)
        file.add(status(1))
        file.flush()
        return file


@pytest.fixture
def deleting(tmp_path: Path) -> Deleting:
    return Deleting(tmp_path)


def test_what_is_asked_for_is_gone_and_nothing_else(deleting: Deleting) -> None:
    for name in ("000001.mcap", "000002-event.mcap", "000003.mcap"):
        deleting.recording(name).finish()
    deleting.ask(2)
    assert deleting.told == [], "nothing waits for the disk"
    assert deleting.became() == [(Result.APPLIED, "it is deleted")]
    assert sorted(os.listdir(deleting.home)) == ["000001.mcap", "000003.mcap"]
    deleting.ask(2)
    assert deleting.became(2)[1] == (Result.APPLIED, "it is gone already")


def test_the_one_that_is_being_written_stays(deleting: Deleting) -> None:
    writing = deleting.recording("000004.mcap")
    (deleting.home / "000005.mcap").touch()  # made, and not locked yet
    for number in (4, 5):
        deleting.ask(number)
    assert {result for result, _ in deleting.became(2)} == {Result.REFUSED}
    assert "it is being written" in deleting.told[0][1]
    assert sorted(os.listdir(deleting.home)) == ["000004.mcap", "000005.mcap"]
    writing.finish()
    deleting.ask(4)
    assert deleting.became(3)[2][0] is Result.APPLIED


def test_a_link_and_a_folder_of_that_name_stay(deleting: Deleting, tmp_path: Path) -> None:
    (tmp_path / "journal.db").write_bytes(b"kept")
    os.symlink(tmp_path / "journal.db", deleting.home / "000006.mcap")
    (deleting.home / "000007.mcap").mkdir()
    for number in (6, 7):
        deleting.ask(number)
    assert {result for result, _ in deleting.became(2)} == {Result.REFUSED}
    assert (tmp_path / "journal.db").read_bytes() == b"kept"
    assert (deleting.home / "000006.mcap").is_symlink()


def test_few_wait(deleting: Deleting) -> None:
    for number in range(MOST_WAITING + 1):
        deleting.ask(number + 1)
    assert deleting.told == [(Result.REFUSED, f"{MOST_WAITING} others wait for the disk: ask again later")]
    assert len(deleting.became(MOST_WAITING + 1)) == MOST_WAITING + 1
