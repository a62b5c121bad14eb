"""A folder of the rover's disk as it is: one level, regular files only, none that is hidden or a link."""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from pathlib import Path

from companion.files.opened import MissingError, Opened, open_in
from companion.files.reader import Reader
from companion.files.tree import presentable

MAX_FILES = 500
_MAX_SCANNED = 5000


class Folder:
    """Files of `path` whose names match `pattern` (as in a shell); of too many the newest 500.

    The folder need not exist yet, and may be a link itself: whoever configures it says where it is.
    """

    def __init__(self, path: Path, pattern: str = "*", reader: Reader | None = None) -> None:
        self._path = path
        self._pattern = pattern
        self._reader = reader or Reader()

    def sizes(self) -> Mapping[str, int]:
        return self._reader.read((self._path, ""), self._sizes)

    def open(self, name: str) -> Opened:
        if not self._shows(name):
            raise MissingError(name)
        return self._reader.read((self._path, name), partial(self._open, name))

    def _sizes(self) -> Mapping[str, int]:
        with self._directory() as directory, os.scandir(directory) as found:
            seen = []
            for entry in islice(found, _MAX_SCANNED):
                with suppress(FileNotFoundError):  # a log turned over, an old call cleared away
                    if self._shows(entry.name) and entry.is_file(follow_symlinks=False):
                        seen.append((entry.stat(follow_symlinks=False), entry.name))
        newest = heapq.nlargest(MAX_FILES, seen, key=lambda file: file[0].st_mtime)
        return {name: status.st_size for status, name in newest}

    def _open(self, name: str) -> Opened:
        with self._directory() as directory:
            return open_in(directory, name)

    def _shows(self, name: str) -> bool:
        return presentable(name) and fnmatchcase(name, self._pattern)

    @contextmanager
    def _directory(self) -> Iterator[int]:
        try:
            descriptor = os.open(self._path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            raise MissingError(self._path.name) from error
        try:
            yield descriptor
        finally:
            os.close(descriptor)
