"""The newest frame's maps as small grey pictures: 0 is black, 1 is white."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from anytraverse.assessment import Assessment, Map
from companion.files.opened import FileError, MissingError
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
    """A map in [0, 1], at most 64 pixels wide, in 16 steps. unknown: what stands for a value that is none.

    Raises FileError, ImportError without OpenCV.
    """
    import cv2

    known = np.where(np.isfinite(values), values, unknown).astype(np.float32)
    height, width = known.shape
    if width > WIDTH:
        size = (WIDTH, max(1, round(height * WIDTH / width)))
        known = np.asarray(cv2.resize(known, size, interpolation=cv2.INTER_AREA), np.float32)
    steps = np.round(known.clip(0, 1) * (LEVELS - 1)) * (255 / (LEVELS - 1))
    done, encoded = cv2.imencode(".png", steps.astype(np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise FileError("the map cannot be encoded")
    return encoded.tobytes()
