"""Detects a frozen camera, in the supervisor: the same picture comes again and again as if new."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image

CHANGED_REGIONS = 6
"""Regions, of 48, that must differ for a picture to count as changed: a drawn-in clock is in at most 4."""

REMEMBERED = 16
"""Pictures with which the newest one is compared: a driver may deliver its old buffers in turn."""
CELLS = (80, 60)
"""Columns and rows of `luma`."""
_REGION = 10
_REGION_SHARE = 0.04
"""Share of a region's cells that must differ for the region to count as changed."""
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
_LEAST, _MOST = 2.0, 3.0
"""Bounds of the brightness difference, of 255, above which a cell counts as changed."""

Luma = NDArray[np.float32]


class FreezeDetector:
    """Measures for how long the picture has been the same although the vehicle moved.

    Time in which the vehicle stands does not count, since a still picture is right then. It does not reset
    the count either: a camera that froze while driving is still frozen once the vehicle was stopped for it.
    """

    def __init__(self) -> None:
        self._different: deque[tuple[Luma, float]] = deque(maxlen=REMEMBERED)
        """The newest pictures that differ from each other, each with what is noise in it."""
        self._seconds = 0.0

    def seconds(self, seen: Luma, moved: float) -> float:
        """Return the seconds for which the vehicle has moved while the picture stayed the same.

        0 for a picture that has changed; a drawn-in clock or compression noise does not count as a change,
        nor does one of the last `REMEMBERED` pictures that comes again.
        seen: `luma` of the newest picture. moved: seconds of motion since the one before.
        """
        if not any(_changed(*one, seen) < CHANGED_REGIONS for one in reversed(self._different)):
            self._different.append((seen, _noise(seen)))
            self._seconds = 0.0
        else:
            self._seconds += moved
        return self._seconds


def changed_regions(reference: Luma, seen: Luma) -> int:
    """Count the regions, of 8 x 6, that differ by more than compression and noise explain.

    The threshold is lower for a picture of low contrast, since motion changes little in fog or in the dark.
    reference, seen: results of `luma`.
    """
    return _changed(reference, _noise(reference), seen)


def _changed(reference: Luma, noise: float, seen: Luma) -> int:
    columns, rows = (cells // _REGION for cells in CELLS)
    changed = (np.abs(seen - reference) > noise).reshape(rows, _REGION, columns, _REGION)
    return int(np.count_nonzero(changed.mean(axis=(1, 3)) >= _REGION_SHARE))


def _noise(luma: Luma) -> float:
    """Return the difference, of 255, that noise explains: from the mean one between neighbouring cells."""
    contrast = float(np.abs(np.diff(luma, axis=0)).mean() + np.abs(np.diff(luma, axis=1)).mean()) / 2
    return min(max(contrast, _LEAST), _MOST)


def luma(picture: Image) -> Luma:
    """Return the mean brightness of 60 x 80 cells, 0 to 255: averaging removes most of the pixel noise."""
    import cv2

    small = cv2.resize(picture, CELLS, interpolation=cv2.INTER_AREA)
    return np.asarray(small.astype(np.float32) @ _LUMA, np.float32)
