"""Reads what the companion has written about its calls, and the end of its log. It only reads."""

from __future__ import annotations

import errno
import json
import os
import re
from pathlib import Path
from typing import Any, BinaryIO

from anytraverse.regular_file import open_regular
from companion.wire.ids import newest_first
from companion.wire.incidents import FOLDER as INCIDENTS
from companion.wire.incidents import read_name

LISTED = 12
"""Calls that are listed, the newest ones."""
LINES = 200
"""Lines of the log that are shown, the newest ones."""
_LARGEST_RECORD, _LARGEST_PICTURE, _LOG = 64 << 10, 1 << 20, 48 << 10
_MOST_SCANNED = 2000
_RECORD = re.compile(r"([0-9]{1,5})\.json", re.ASCII)


class StateFolder:
    """Reads the daemon's state folder. No name comes from a client but those of incident files, which are
    checked; the others are made of numbers and hashes here.

    Each method waits for the disk, and raises OSError.
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._calls = Path(folder, "calls")
        self._scenes = Path(folder, "scenes")
        self._logs = Path(folder, "logs")
        self._incidents = Path(folder, INCIDENTS)

    def picture(self, number: int, size: str = "") -> bytes:
        """Return the picture of a call or hold, as JPEG.

        size: "" as radios carry it, "-large" with maps, "-raw" as large and without a mark.
        """
        return _read(self._calls, f"{number}{size}.jpg", _LARGEST_PICTURE)

    def scene(self, name: str) -> bytes:
        """Return the picture of a remembered scene that no call taught, JPEG. name: 16 digits of a hash."""
        return _read(self._scenes, f"{name}.jpg", _LARGEST_PICTURE)

    def incident(self, name: str) -> BinaryIO:
        """Open an incident file. Raises FileNotFoundError for a name that is none of them."""
        if read_name(name) is None:
            raise FileNotFoundError(name)
        return open(open_regular(self._incidents / name, follow=False), "rb", buffering=0)

    def address(self, path: str) -> str:
        """Return the address of a picture, which changes with the picture; "" where there is none.

        path: as a record has it: "/calls/7.jpg".
        """
        try:
            return f"{path}?v={os.lstat(self._folder + path).st_mtime_ns // 1_000_000}"
        except (OSError, ValueError):
            return ""

    def calls(self) -> list[dict[str, Any]]:
        """Return the records of the newest calls, the newest first. One that cannot be read is left out."""
        found = []
        for number in newest_first(self._numbers())[:LISTED]:
            try:
                record = json.loads(_read(self._calls, f"{number}.json", _LARGEST_RECORD))
            except (OSError, ValueError, RecursionError):
                continue
            if isinstance(record, dict):
                found.append({**record, "id": number})
        return found

    def log(self) -> str:
        """Return the last lines of the log; without a log, those of the file before it."""
        text = ""
        for name in ("companion.log", "companion.log.1"):
            try:
                text = _read(self._logs, name, _LOG, end=True).decode(errors="replace") + text
            except FileNotFoundError:
                continue
            if text.count("\n") > LINES:
                break
        return "\n".join(text.splitlines()[-LINES:])

    def _numbers(self) -> list[int]:
        numbers = []
        try:
            with os.scandir(self._calls) as found:
                for entry, _ in zip(found, range(_MOST_SCANNED), strict=False):
                    if named := _RECORD.fullmatch(entry.name):
                        numbers.append(int(named[1]))
        except FileNotFoundError:
            pass
        return numbers


def _read(folder: Path, name: str, most: int, *, end: bool = False) -> bytes:
    """Read a file of `most` bytes at most. end: read the end of a longer one instead of refusing it."""
    descriptor = open_regular(folder / name, follow=False)
    try:
        size = os.fstat(descriptor).st_size
        if size > most and not end:
            raise OSError(errno.EFBIG, f"{size} bytes, at most {most} are served", name)
        return os.pread(descriptor, most, max(0, size - most))
    finally:
        os.close(descriptor)
