"""The read-only tree that the ground sees: files and folders of files, nothing deeper, nothing else."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, TypeVar

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


_T = TypeVar("_T")

MAX_NAME = 128
"""Bytes of a name in UTF-8: a path and a line of a list both fit one frame."""


class Entry(NamedTuple):
    """A line of a list. size: bytes; None for a folder."""

    name: str
    size: int | None


class Shelf(Protocol):
    """A folder of the tree. Both run in the link's thread: within some milliseconds, or LaterError."""

    def sizes(self) -> Mapping[str, int]:
        """The names of its files, and their bytes."""

    def open(self, name: str) -> Opened:
        """One of them. Raises FileError."""


class Document:
    """A file that is made when it is opened or listed, by `make`, in the link's thread."""

    def __init__(self, make: Callable[[], bytes]) -> None:
        self._make = make

    def open(self) -> Opened:
        """Its content now. Raises FileError."""
        return Held(self._make())


class Documents:
    """A folder of files that are made when they are opened. sizes: names and bytes, cheap to ask for."""

    def __init__(self, sizes: Callable[[], Mapping[str, int]], make: Callable[[str], bytes]) -> None:
        self._sizes = sizes
        self._make = make

    def sizes(self) -> Mapping[str, int]:
        return self._sizes()

    def open(self, name: str) -> Opened:
        if name not in self._sizes():
            raise MissingError(name)
        return Held(self._make(name))


class Tree:
    """Mounts by name: `Document` is a file of the root, everything else a folder of it.

    A provider that fails costs its own file only. Raises ValueError for a name that cannot be shown.
    """

    def __init__(self, mounts: Mapping[str, Document | Shelf] | None = None) -> None:
        self._mounts = dict(mounts or {})
        for name in self._mounts:
            if not presentable(name):
                raise ValueError(f'"{name}" cannot be the name of a file for the ground')

    def beside(self, name: str, folder: Shelf) -> Tree:
        """The same with one folder more. Raises ValueError for a name that cannot be shown."""
        return Tree({**self._mounts, name: folder})

    def entries(self, path: str) -> tuple[Entry, ...]:
        """What a folder holds, by name. Raises FileError."""
        match _parts(path):
            case []:
                return tuple(self._entry(name) for name in sorted(self._mounts))
            case [name] if (mount := self._mounts.get(name)) and not isinstance(mount, Document):
                return tuple(Entry(file, size) for file, size in sorted(_sizes(mount).items()))
            case _:
                raise MissingError(path)

    def open(self, path: str) -> Opened:
        """A file as it is now. Raises FileError."""
        match _parts(path):
            case [name] if isinstance(mount := self._mounts.get(name), Document):
                return _guarded(mount.open)
            case [folder, name] if (mount := self._mounts.get(folder)) and not isinstance(mount, Document):
                shelf = mount
                return _guarded(lambda: shelf.open(name))
            case _:
                raise MissingError(path)

    def _entry(self, name: str) -> Entry:
        mount = self._mounts[name]
        if not isinstance(mount, Document):
            return Entry(name, None)
        try:
            opened = _guarded(mount.open)
        except FileError:
            return Entry(name, 0)
        opened.close()
        return Entry(name, opened.size)


def presentable(name: str) -> bool:
    """Whether a name may be seen and asked for: visible, no folder in it, UTF-8, not longer than a frame."""
    if not name or name.startswith(".") or "/" in name or not name.isprintable():
        return False
    return len(name.encode(errors="replace")) <= MAX_NAME


def _parts(path: str) -> list[str]:
    parts = [part for part in path.split("/") if part]
    if not all(presentable(part) for part in parts):
        raise MissingError(path)
    return parts


def _sizes(shelf: Shelf) -> dict[str, int]:
    sizes = _guarded(shelf.sizes)
    return {name: size for name, size in sizes.items() if presentable(name)}


def _guarded(provide: Callable[[], _T]) -> _T:
    try:
        return provide()
    except FileError:
        raise
    except Exception as error:  # a provider's mistake must not cost the radio link
        raise FileError(f"{type(error).__name__}: {error}") from error
