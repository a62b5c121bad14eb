"""The newest frame's maps as small grey pictures: 0 is black, 1 is white."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Assessment, Map
from companion.files.opened import MissingError
from companion.files.tree import Documents

WIDTH = 64
LEVELS = 16
"""Steps of grey: fewer bytes, and nobody sees more."""


class NewestMaps:
    """traversability.png and uncertainty.png, made at most once a frame, and only when asked for."""

    def __init__(self, newest: Callable[[], Assessment | None]) -> None:
        self._newest = newest
        self._seen: Assessment | None = None
        self._made: dict[str, bytes] = {}

    def documents(self) -> Documents:
        """As a folder."""
        return Documents(self._sizes, self._make)

    def _sizes(self) -> Mapping[str, int]:
        seen = self._newest()
        if seen is not self._seen:
            maps = seen.maps if seen is not None else None
            self._seen, self._made = seen, {}
            if maps is not None:
                self._made["traversability.png"] = grey_png(maps.traversability, unknown=0.0)
                self._made["uncertainty.png"] = grey_png(maps.uncertainty, unknown=1.0)
        return {name: len(content) for name, content in self._made.items()}

    def _make(self, name: str) -> bytes:
        if name not in self._made:
            raise MissingError(name)
        return self._made[name]


def grey_png(values: Map, unknown: float) -> bytes:
    """A map in [0, 1], at most 64 pixels wide, in 16 steps. unknown: what stands for a value that is none."""
    known = np.where(np.isfinite(values), values, unknown).astype(np.float32)
    height, width = known.shape
    if width > WIDTH:
        known = _averaged(known, max(1, round(height * WIDTH / width)), WIDTH)
    steps = np.round(known.clip(0, 1) * (LEVELS - 1)) * (255 / (LEVELS - 1))
    return _png(steps.astype(np.uint8))


def _averaged(values: Map, height: int, width: int) -> Map:
    """The mean of each of height x width blocks of pixels."""
    rows, columns = (
        np.linspace(0, size, count + 1).astype(np.intp)[:-1]
        for size, count in zip(values.shape, (height, width), strict=True)
    )
    sums = np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)
    tall, wide = np.diff(rows, append=values.shape[0]), np.diff(columns, append=values.shape[1])
    means: Map = (sums / np.outer(tall, wide)).astype(np.float32)
    return means


def _png(grey: NDArray[np.uint8]) -> bytes:
    """PNG (ISO/IEC 15948) of (height, width) grey pixels: the supervisor has no OpenCV."""
    height, width = grey.shape
    rows = np.zeros((height, width + 1), np.uint8)  # each row begins with its filter: none
    rows[:, 1:] = grey
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )
