"""Defines the read-only tree of served files: files and folders of files, nothing deeper."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, TypeVar

from anytraverse.regular_file import open_regular

MAX_SIZE = 8 * 1024 * 1024
"""Bytes of the largest file that is served. It takes 1.5 h at 1,500 B/s."""


class FileError(Exception):
    """The file cannot be served. The message says why."""


class MissingError(FileError):
    """There is no such file or folder, or it is not served."""


class LaterError(FileError):
    """The file is not read yet: ask again."""


class Opened(Protocol):
    """Reads an open file. size: bytes, fixed while it is open. `close` may come before `read`."""

    size: int

    def read(self, offset: int, count: int) -> bytes:
        """Return `count` bytes from `offset`, fewer only at the file's end. Raises FileError."""

    def close(self) -> None:
        """Close the file. May be called more than once."""


class InMemoryFile:
    """Serves bytes in memory as an open file."""

    def __init__(self, content: bytes) -> None:
        if len(content) > MAX_SIZE:
            raise FileError(f"{len(content)} bytes, at most {MAX_SIZE} are served")
        self.size = len(content)
        self._content = content

    def read(self, offset: int, count: int) -> bytes:
        return self._content[offset : offset + count]

    def close(self) -> None:
        self._content = b""


def read_regular_file(folder: int, name: str) -> Opened:
    """Read the regular file `name` of the directory descriptor `folder` into memory. Raises FileError.

    A symbolic link is refused: it could lead out of the folder.
    """
    try:
        descriptor = open_regular(name, folder=folder, follow=False)
    except OSError as error:
        raise MissingError(name) from error
    try:
        size = os.fstat(descriptor).st_size
        if size > MAX_SIZE:
            raise FileError(f"{size} bytes, at most {MAX_SIZE} are served")
        return InMemoryFile(os.pread(descriptor, size, 0))
    finally:
        os.close(descriptor)


_T = TypeVar("_T")

MAX_NAME = 128
"""Bytes of a name in UTF-8: a path and a line of a list both fit one MAVLink FTP payload."""


class ListingEntry(NamedTuple):
    """Describes a file or folder in a listing. size: bytes; None for a folder."""

    name: str
    size: int | None


class ServedFolder(Protocol):
    """Serves a folder of the tree.

    The main loop calls both methods: they return within some milliseconds, or raise LaterError.
    """

    def sizes(self) -> Mapping[str, int]:
        """Return the names and sizes, in bytes, of the files."""

    def open(self, name: str) -> Opened:
        """Open a file. Raises FileError."""


class Document:
    """Serves a file whose content `make` produces in the main loop whenever it is opened or listed."""

    def __init__(self, make: Callable[[], bytes]) -> None:
        self._make = make

    def open(self) -> Opened:
        """Make the content. Raises FileError."""
        return InMemoryFile(self._make())


class Documents:
    """Serves a folder whose files `make` produces when they are opened. sizes: a cheap listing."""

    def __init__(self, sizes: Callable[[], Mapping[str, int]], make: Callable[[str], bytes]) -> None:
        self._sizes = sizes
        self._make = make

    def sizes(self) -> Mapping[str, int]:
        return self._sizes()

    def open(self, name: str) -> Opened:
        if name not in self._sizes():
            raise MissingError(name)
        return InMemoryFile(self._make(name))


class Tree:
    """Serves files and folders under names: a `Document` is a file in the root, a `ServedFolder` is a folder.

    When one of them raises, only its own files fail. Raises ValueError for a name that cannot be served.
    """

    def __init__(self, mounts: Mapping[str, Document | ServedFolder] | None = None) -> None:
        self._mounts = dict(mounts or {})
        for name in self._mounts:
            if not presentable(name):
                raise ValueError(f'"{name}" cannot be the name of a file for the ground')

    def with_folder(self, name: str, folder: ServedFolder) -> Tree:
        """Return a copy with one more folder. Raises ValueError for a name that cannot be served."""
        return Tree({**self._mounts, name: folder})

    def entries(self, path: str) -> tuple[ListingEntry, ...]:
        """List a folder in name order. Raises FileError."""
        match _parts(path):
            case []:
                return tuple(self._entry(name) for name in sorted(self._mounts))
            case [name] if (mount := self._mounts.get(name)) and not isinstance(mount, Document):
                return tuple(ListingEntry(file, size) for file, size in sorted(_sizes(mount).items()))
            case _:
                raise MissingError(path)

    def open(self, path: str) -> Opened:
        """Open a file with its present content. Raises FileError."""
        match _parts(path):
            case [name] if isinstance(mount := self._mounts.get(name), Document):
                return _guarded(mount.open)
            case [folder, name] if (mount := self._mounts.get(folder)) and not isinstance(mount, Document):
                served = mount
                return _guarded(lambda: served.open(name))
            case _:
                raise MissingError(path)

    def _entry(self, name: str) -> ListingEntry:
        mount = self._mounts[name]
        if not isinstance(mount, Document):
            return ListingEntry(name, None)
        try:
            opened = _guarded(mount.open)
        except FileError:
            return ListingEntry(name, 0)
        opened.close()
        return ListingEntry(name, opened.size)


def presentable(name: str) -> bool:
    """Whether a name may be served: not hidden, printable, without a slash, at most `MAX_NAME` bytes."""
    if not name or name.startswith(".") or "/" in name or not name.isprintable():
        return False
    return len(name.encode(errors="replace")) <= MAX_NAME


def _parts(path: str) -> list[str]:
    parts = [part for part in path.split("/") if part]
    if not all(presentable(part) for part in parts):
        raise MissingError(path)
    return parts


def _sizes(folder: ServedFolder) -> dict[str, int]:
    sizes = _guarded(folder.sizes)
    return {name: size for name, size in sizes.items() if presentable(name)}


def _guarded(provide: Callable[[], _T]) -> _T:
    try:
        return provide()
    except FileError:
        raise
    except Exception as error:  # an error in making a file must not end the main loop
        raise FileError(f"{type(error).__name__}: {error}") from error
