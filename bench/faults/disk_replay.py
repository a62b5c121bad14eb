"""Computes which files a disk holds after a loss of power, from the recorded changes of a program.

POSIX promises only that what was synced is on disk: a file's content by fsync of the file, its name by fsync
of its folder. Anything else may be there or not. The record's format stands in recording_disk.c.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

_HEAD = struct.Struct("<cHHQI")
SECTOR = 512
"""Bytes that a disk writes whole or not at all."""


class DiskChange(NamedTuple):
    """One recorded change.

    kind: c create a file, t set its length to `offset`, w write `data` at `offset`, s sync, r rename to
    `other`, l link as `other`, u unlink, m make a folder. end: bytes of the record up to and with this
    change.
    """

    kind: str
    path: str
    other: str
    offset: int
    data: bytes
    end: int


def read_record(path: Path) -> list[DiskChange]:
    """Read the recorded changes; the last one may be torn and is then left out."""
    whole, at, changes = path.read_bytes(), 0, list[DiskChange]()
    while at + _HEAD.size <= len(whole):
        kind, first, second, offset, length = _HEAD.unpack_from(whole, at)
        at += _HEAD.size
        end = at + first + second + length
        if end > len(whole):
            break
        names = whole[at : at + first].decode(), whole[at + first : at + first + second].decode()
        changes.append(DiskChange(kind.decode(), *names, offset, whole[end - length : end], end))
        at = end
    return changes


@dataclass
class _File:
    durable: bytes = b""
    """Content that is on disk for certain."""
    unsynced: list[DiskChange] = field(default_factory=list)
    folder: bool = False


class Disk:
    """Knows what is on disk for certain after some changes, and what may be.

    Names are kept twice: as the program sees them, and as they are on disk for certain. Changes of names are
    written in their order, as a journaling file system does.
    """

    def __init__(self, root: str) -> None:
        """root: the folder that was recorded; it was empty and is on disk."""
        self._root = root.rstrip("/")
        self._seen: dict[str, _File] = {self._root: _File(folder=True)}
        self._durable = dict(self._seen)
        self._names: list[DiskChange] = []
        """Changes of names that are not synced, in order."""
        self._files: dict[DiskChange, _File] = {}

    def apply(self, change: DiskChange) -> None:
        """Apply the next change."""
        path = change.path.rstrip("/")
        match change.kind:
            case "w" | "t":
                self._seen[path].unsynced.append(change)
            case "s":
                self._sync(path)
            case _:
                if change.kind in "cm":
                    self._files[change] = _File(folder=change.kind == "m")
                self._names.append(change)
                self._rename(self._seen, change)

    def content(self, chance: random.Random | None = None) -> dict[str, bytes]:
        """Return what a loss of power leaves: path -> content; folders end in "/".

        chance: None throws away all that was not synced. Else a random part of it is on disk: of the names'
        changes the first ones, of writes any sectors.
        """
        names = dict(self._durable)
        kept = chance.randint(0, len(self._names)) if chance else 0
        for change in self._names[:kept]:
            self._rename(names, change)
        return {
            path + "/" * file.folder: b"" if file.folder else _content(file, chance)
            for path, file in names.items()
            if path != self._root
        }

    def now(self) -> dict[str, bytes]:
        """Return what the program sees, which a killed process leaves: path -> content."""
        return {
            path + "/" * file.folder: b"" if file.folder else _applied(file.durable, file.unsynced)
            for path, file in self._seen.items()
            if path != self._root
        }

    def _sync(self, path: str) -> None:
        file = self._seen[path]
        if not file.folder:
            file.durable, file.unsynced = _applied(file.durable, file.unsynced), []
            return
        # Names are written in order: all up to the last one in this folder.
        last = max((n for n, one in enumerate(self._names) if _in_folder(one, path)), default=-1)
        for change in self._names[: last + 1]:
            self._rename(self._durable, change)
        del self._names[: last + 1]

    def _rename(self, names: dict[str, _File], change: DiskChange) -> None:
        path = change.path.rstrip("/")
        match change.kind:
            case "c" | "m":
                names[path] = self._files[change]
            case "r" if path in names:
                names[change.other] = names.pop(path)
            case "l" if path in names:
                names[change.other] = names[path]
            case "u":
                names.pop(path, None)


def _in_folder(change: DiskChange, folder: str) -> bool:
    return any(name.rpartition("/")[0] == folder for name in (change.path.rstrip("/"), change.other) if name)


def _content(file: _File, chance: random.Random | None) -> bytes:
    if chance is None:
        return file.durable
    kept = [part for change in file.unsynced for part in _parts(change) if chance.random() < 0.5]
    return _applied(file.durable, kept)


def _parts(change: DiskChange) -> list[DiskChange]:
    """Split a write into sectors; any other change is one part."""
    if change.kind != "w":
        return [change]
    first = -change.offset % SECTOR
    cuts = [0, *range(first, len(change.data), SECTOR), len(change.data)]
    return [
        change._replace(offset=change.offset + low, data=change.data[low:high])
        for low, high in pairwise(cuts)
        if high > low
    ]


def _applied(content: bytes, changes: Sequence[DiskChange]) -> bytes:
    whole = bytearray(content)
    for change in changes:
        if change.kind == "t":
            del whole[change.offset :]
            whole.extend(bytes(change.offset - len(whole)))
        else:
            whole.extend(bytes(max(0, change.offset - len(whole))))
            whole[change.offset : change.offset + len(change.data)] = change.data
    return bytes(whole)


def lay_out(content: dict[str, bytes], recorded: str, folder: Path) -> None:
    """Write files, which were recorded in folder `recorded`, into another folder."""
    for path, data in sorted(content.items()):
        target = folder / path.removeprefix(recorded).strip("/")
        if path.endswith("/"):
            target.mkdir(parents=True, exist_ok=True)
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
