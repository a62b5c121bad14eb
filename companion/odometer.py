"""Metres driven, from the positions that the autopilot tells."""

from __future__ import annotations

import math

_METRES_PER_DEGREE = 111_320.0
_JUMP = 20.0
"""Metres between two positions beyond which it is no driving but a new fix."""
_JITTER = 0.3
"""Metres below which a position may be noise; it counts once it adds up."""


class Odometer:
    """Adds up the way between positions; None until the first is known."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._metres = 0.0

    def travelled(self, position: tuple[float, float, float | None] | None) -> float | None:
        """Metres so far, with the newest position (latitude, longitude in degrees) counted."""
        if position is not None:
            latitude, longitude, _ = position
            if self._last is None:
                self._last = latitude, longitude
            north = (latitude - self._last[0]) * _METRES_PER_DEGREE
            east = (longitude - self._last[1]) * _METRES_PER_DEGREE * math.cos(math.radians(latitude))
            step = math.hypot(north, east)
            if step >= _JITTER:
                self._last = latitude, longitude
                self._metres += step if step <= _JUMP else 0.0
        return None if self._last is None else self._metres
