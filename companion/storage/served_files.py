"""Serves files to the ground: folders of the disk, the newest maps, and documents such as /state.json."""

from __future__ import annotations

import heapq
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Assessment, Map
from companion.storage.call_files import PATTERN, SCENE_PATTERN, SCENES
from companion.storage.file_reader import FileReader
from companion.storage.log_file import FOLDER, NAME
from companion.storage.served_tree import (
    Document,
    Documents,
    MissingError,
    Opened,
    Tree,
    presentable,
    read_regular_file,
)
from companion.wire import incidents
from companion.wire.documents import FROM_ABOVE

MAX_FILES = 500
_MAX_SCANNED = 5000


class MatchingFiles:
    """Serves the files of `path` whose names match the shell pattern, the newest `MAX_FILES` of them.

    The folder need not exist yet. It may be a symbolic link, unlike the files in it: the owner chose it.
    """

    def __init__(self, path: Path, pattern: str = "*", reader: FileReader | None = None) -> None:
        self._path = path
        self._pattern = pattern
        self._reader = reader or FileReader()

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
                with suppress(FileNotFoundError):  # deleted meanwhile: a log rotated, or an old call's files
                    if self._shows(entry.name) and entry.is_file(follow_symlinks=False):
                        seen.append((entry.stat(follow_symlinks=False), entry.name))
        newest = heapq.nlargest(MAX_FILES, seen, key=lambda file: file[0].st_mtime)
        return {name: status.st_size for status, name in newest}

    def _open(self, name: str) -> Opened:
        with self._directory() as directory:
            return read_regular_file(directory, name)

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


WIDTH = 64
LEVELS = 16
"""Steps of grey: enough for the eye, and the PNG is smaller."""


class NewestMaps:
    """Makes traversability.png and uncertainty.png, at most once a frame, and only on request.

    from_above.png is there where the ground is known in metres.
    """

    def __init__(self, newest: Callable[[], Assessment | None], from_above: Callable[[], bytes]) -> None:
        self._newest = newest
        self._from_above = from_above
        self._seen: Assessment | None = None
        self._made: dict[str, bytes] = {}

    def documents(self) -> Documents:
        """Return the maps as a folder of files."""
        return Documents(self._sizes, self._make)

    def _sizes(self) -> Mapping[str, int]:
        seen = self._newest()
        if seen is not self._seen:
            maps = seen.maps if seen is not None else None
            self._seen, self._made = seen, {}
            if maps is not None:
                self._made["traversability.png"] = grey_png(maps.traversability, unknown=0.0)
                self._made["uncertainty.png"] = grey_png(maps.uncertainty, unknown=1.0)
        self._made[Path(FROM_ABOVE).name] = self._from_above()
        return {name: len(content) for name, content in self._made.items() if content}

    def _make(self, name: str) -> bytes:
        if not (content := self._made.get(name)):
            raise MissingError(name)
        return content


def grey_png(values: Map, unknown: float) -> bytes:
    """Encode a map, (height, width) in [0, 1], as PNG at most 64 pixels wide, in 16 steps of grey.

    unknown: the value to show where the map is not finite.
    """
    known = np.where(np.isfinite(values), values, unknown).astype(np.float32)
    height, width = known.shape
    if width > WIDTH:
        known = _averaged(known, max(1, round(height * WIDTH / width)), WIDTH)
    steps = np.round(known.clip(0, 1) * (LEVELS - 1)) * (255 / (LEVELS - 1))
    return png(steps.astype(np.uint8))


def _averaged(values: Map, height: int, width: int) -> Map:
    """Return the mean of each of height x width blocks of pixels."""
    rows, columns = (
        np.linspace(0, size, count + 1).astype(np.intp)[:-1]
        for size, count in zip(values.shape, (height, width), strict=True)
    )
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)
    tall, wide = np.diff(rows, append=values.shape[0]), np.diff(columns, append=values.shape[1])
    means: Map = (sums / np.outer(tall, wide)).astype(np.float32)
    return means


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode grey pixels (height, width), or RGB (height, width, 3), as PNG (ISO/IEC 15948).

    The supervisor does not load OpenCV.
    """
    height, width = pixels.shape[:2]
    filters = np.zeros((height, 1), np.uint8)  # the first byte of a row names its filter; 0: none
    rows = np.hstack([filters, pixels.reshape(height, -1)])
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


class ServedFiles:
    """Serves /state.json, /check.json, /incidents.json, /calls, /maps, /scenes, /logs and /incidents."""

    def __init__(self, folder: Path, reader: FileReader | None = None) -> None:
        """folder: the journal's. reader: reads what is on the disk."""
        self.calls = folder / "calls"
        with suppress(OSError):  # writing a call's files will fail, and is logged then
            self.calls.mkdir(parents=True, exist_ok=True)
        self._figures: Callable[[], Mapping[str, Any]] = lambda: {"state": "starting"}
        self._newest: Callable[[], Assessment | None] = lambda: None
        self._from_above: Callable[[], bytes] = bytes
        self._checks: Callable[[], Mapping[str, Any]] = lambda: {"state": "starting"}
        self._incidents: Callable[[], Mapping[str, Any]] = incidents.Incidents().document
        self.tree = Tree(
            {
                "state.json": Document(lambda: _as_json(self._figures())),
                "check.json": Document(lambda: _as_json(self._checks())),
                incidents.DOCUMENT: Document(lambda: _as_json(self._incidents())),
                "calls": MatchingFiles(self.calls, PATTERN, reader),
                "maps": NewestMaps(self._newest_frame, self._map_from_above).documents(),
                SCENES: MatchingFiles(folder / SCENES, SCENE_PATTERN, reader),
                "logs": MatchingFiles(folder / FOLDER, f"{NAME}*", reader),
                incidents.FOLDER: MatchingFiles(folder / incidents.FOLDER, "*.zip", reader),
            }
        )

    def started(
        self,
        figures: Callable[[], Mapping[str, Any]],
        newest: Callable[[], Assessment | None],
        from_above: Callable[[], bytes],
    ) -> None:
        """Serve a daemon's state from now on. The link serves files before the perceiver is loaded.

        figures: makes the content of /state.json. newest: the newest frame. from_above: makes
        /maps/from_above.png, b"" where there is none.
        """
        self._figures, self._newest, self._from_above = figures, newest, from_above

    def show_checks(self, checks: Callable[[], Mapping[str, Any]]) -> None:
        """Serve these as /check.json from now on. checks: makes its content."""
        self._checks = checks

    def show_incidents(self, told: Callable[[], Mapping[str, Any]]) -> None:
        """Serve this as /incidents.json from now on. told: makes its content."""
        self._incidents = told

    def _map_from_above(self) -> bytes:
        return self._from_above()

    def _newest_frame(self) -> Assessment | None:
        return self._newest()


def _as_json(figures: Mapping[str, Any]) -> bytes:
    return json.dumps(figures, separators=(",", ":")).encode()
