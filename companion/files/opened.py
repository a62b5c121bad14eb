"""A file that is being read, as it was when it was opened."""

from __future__ import annotations

import os
import stat
from typing import Protocol

MAX_SIZE = 8 * 1024 * 1024
"""Bytes of the largest file that is served: 1.5 h at 1,500 B/s."""


class FileError(Exception):
    """A file that cannot be served; the message says why."""


class MissingError(FileError):
    """There is no such file or folder, or it is not to be seen."""


class LaterError(FileError):
    """It is not there yet: ask again."""


class Opened(Protocol):
    """size: bytes, fixed while it is open. `read` and `close` may be called in any order."""

    size: int

    def read(self, offset: int, count: int) -> bytes:
        """At most `count` bytes from `offset`; fewer only at the end. Raises FileError."""

    def close(self) -> None:
        """Give it back; twice is harmless."""


class Held:
    """Bytes in memory."""

    def __init__(self, content: bytes) -> None:
        if len(content) > MAX_SIZE:
            raise FileError(f"{len(content)} bytes, at most {MAX_SIZE} are served")
        self.size = len(content)
        self._content = content

    def read(self, offset: int, count: int) -> bytes:
        return self._content[offset : offset + count]

    def close(self) -> None:
        self._content = b""


def open_in(folder: int, name: str) -> Opened:
    """The regular file `name` of the open directory `folder`, as it is, never a link. Raises FileError."""
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(name, flags, dir_fd=folder)
    except OSError as error:
        raise MissingError(name) from error
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise MissingError(f"{name} is no regular file")
        if status.st_size > MAX_SIZE:
            raise FileError(f"{status.st_size} bytes, at most {MAX_SIZE} are served")
        return Held(os.pread(descriptor, status.st_size, 0))
    finally:
        os.close(descriptor)
