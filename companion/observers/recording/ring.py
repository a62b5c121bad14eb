"""Decides which recordings stay on disk: a ring of a set size that keeps longest what surrounds events."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

FOLDER = "recordings"
LEAST_FREE = 200 << 20
"""Bytes that stay free on the disk: for the journal and for everybody else."""
_NAME = re.compile(r"([0-9]{6,9})(-event)?\.mcap", re.ASCII)
PARTIAL = re.compile(rf"\.{_NAME.pattern}\.part", re.ASCII)
"""The name of a recording that is being repaired."""
_LAST = 999_999_999


class RecordingFile(NamedTuple):
    """One file. number: rises by one from file to file. event: whether a call, hold or fault is in it."""

    number: int
    event: bool
    size: int

    @property
    def name(self) -> str:
        """The file's name."""
        return name_of(self.number, event=self.event)


def name_of(number: int, *, event: bool) -> str:
    """Return the name of a file. A time would not do: a rover often boots without a clock."""
    return f"{number:06d}{'-event' if event else ''}.mcap"


def free_number(folder: Path, first: int) -> int:
    """Return the first number from `first` on whose name is free. Raises OSError after the last one."""
    for number in range(first, _LAST + 1):
        if not os.path.lexists(folder / name_of(number, event=False)):
            return number
    raise OSError(f"{name_of(_LAST, event=False)} has the last number: move it to another folder")


def recordings(folder: Path) -> list[RecordingFile]:
    """List the recordings of a folder, oldest first; none where there is no folder. Raises OSError.

    What is no regular file is none of ours, whatever its name: opening it might never end.
    """
    found = []
    with contextlib.suppress(FileNotFoundError), os.scandir(folder) as entries:
        for entry in entries:
            named = _NAME.fullmatch(entry.name)
            if named and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(FileNotFoundError):
                    size = entry.stat(follow_symlinks=False).st_size
                    found.append(RecordingFile(int(named[1]), named[2] is not None, size))
    return sorted(found)


def surplus(found: Iterable[RecordingFile], most: int) -> list[RecordingFile]:
    """Return the recordings to delete, so that the rest has at most `most` bytes.

    First go, oldest first, those without an event. A recording beside one with an event counts as one with an
    event, and so does the newest, since the next one may have one.
    """
    found = sorted(found)
    numbers = {one.number for one in found if one.event}
    newest = found[-1].number if found else 0

    def kept(one: RecordingFile) -> bool:
        return one.number == newest or bool(numbers & {one.number - 1, one.number, one.number + 1})

    left, deleted = sum(one.size for one in found), []
    for one in sorted(found, key=lambda one: (kept(one), one.number)):
        if left <= most:
            break
        left -= one.size
        deleted.append(one)
    return deleted


def make_room(folder: Path, most: int) -> None:
    """Delete recordings until all of them have at most `most` bytes. Raises OSError."""
    for one in surplus(recordings(folder), most):
        (folder / one.name).unlink(missing_ok=True)
