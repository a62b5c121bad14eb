"""A camera that delivers the same picture again and again, each as if just taken, sees nothing any more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image

CHANGED_REGIONS = 6
"""Of the 48 regions of a picture, how many must differ for it to be another one: a clock is in 4 at most."""

_CELLS, _REGION = (80, 60), 10
_REGION_SHARE = 0.04
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
_LEAST, _MOST = 2.0, 3.0

_Luma = NDArray[np.float32]


class FrozenPicture:
    """How far the newest picture is behind.

    The time in which the vehicle stood does not count: then a still picture is right. What counted before
    stays: a camera that froze while driving is no better once the vehicle was stopped for it.
    """

    def __init__(self) -> None:
        self._shape: tuple[int, ...] = ()
        self._reference: _Luma | None = None
        self._looked_at = 0.0
        self._seconds = 0.0

    def seconds(self, picture: Image, now: float, *, moving: bool) -> float:
        """For how long the vehicle has moved while the picture stayed the same; 0 for another picture.

        A clock drawn into it and another compression make no other picture.
        picture: the newest, RGB, (height, width, 3) uint8. now: monotonic seconds.
        """
        seen = luma(picture)
        same = (
            self._reference is not None
            and picture.shape == self._shape
            and changed_regions(self._reference, seen) < CHANGED_REGIONS
        )
        if not same:
            self._reference, self._shape, self._seconds = seen, picture.shape, 0.0
        elif moving:
            self._seconds += now - self._looked_at
        self._looked_at = now
        return self._seconds


def changed_regions(reference: _Luma, seen: _Luma) -> int:
    """How many of the 8 x 6 regions differ by more than compression and noise make them differ.

    In fog or in little light motion changes little: there less counts. reference, seen: as `luma` gives them.
    """
    noise = min(max(_steps(reference), _LEAST), _MOST)
    columns, rows = (cells // _REGION for cells in _CELLS)
    changed = (np.abs(seen - reference) > noise).reshape(rows, _REGION, columns, _REGION)
    return int(np.count_nonzero(changed.mean(axis=(1, 3)) >= _REGION_SHARE))


def _steps(luma: _Luma) -> float:
    """The mean difference between neighbours, of 255."""
    return float(np.abs(np.diff(luma, axis=0)).mean() + np.abs(np.diff(luma, axis=1)).mean()) / 2


def luma(picture: Image) -> _Luma:
    """(60, 80) mean brightness of the picture's cells, 0 to 255; a mean has little of a pixel's noise."""
    import cv2

    small = cv2.resize(picture, _CELLS, interpolation=cv2.INTER_AREA)
    return np.asarray(small.astype(np.float32) @ _LUMA, np.float32)
