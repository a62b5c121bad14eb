"""A camera that delivers the same picture again and again, each as if just taken, sees nothing any more."""

from __future__ import annotations

import numpy as np

from anytraverse.frame import Image


class FrozenPicture:
    """How far the newest picture is behind.

    The time in which the vehicle stood does not count: then a still picture is right. What counted before
    stays: a camera that froze while driving is no better once the vehicle was stopped for it.
    """

    def __init__(self) -> None:
        self._picture: Image | None = None
        self._looked_at = 0.0
        self._seconds = 0.0

    def seconds(self, picture: Image, now: float, *, moving: bool) -> float:
        """For how long the vehicle has moved and no pixel has changed; 0 for a new picture.

        picture: the newest, RGB, (height, width, 3) uint8. now: monotonic seconds.
        """
        if self._picture is None or not np.array_equal(picture, self._picture):
            self._picture, self._seconds = picture, 0.0
        elif moving:
            self._seconds += now - self._looked_at
        self._looked_at = now
        return self._seconds
