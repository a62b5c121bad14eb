"""Reads a place of JSON values, and measures how far the vehicle has driven."""

from __future__ import annotations

import math
from typing import Any

from anytraverse.history import Place
from companion.wire.places import place_attributes


def read_place(saved: Any) -> Place:
    """Read what `place_document` made. Values that are missing or out of range are left unknown."""
    return Place(**place_attributes(saved))


_METRES_PER_DEGREE = 111_320.0
_JUMP = 20.0
"""Metres. A longer step between two positions is a new fix and no driving; it is not counted."""
_JITTER = 0.3
"""Metres. A shorter step may be noise; it counts once the vehicle is this far from the last counted point."""


class Odometer:
    """Adds up the distances between the vehicle's positions."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._metres = 0.0

    def travelled(self, position: tuple[float, float, float | None] | None) -> float | None:
        """Add the newest position (latitude and longitude in degrees), and return the metres driven so far.

        None until a first position is known.
        """
        if position is not None:
            latitude, longitude, _ = position
            if self._last is None:
                self._last = latitude, longitude
            # A flat earth is exact enough here: steps are a few metres long.
            north = (latitude - self._last[0]) * _METRES_PER_DEGREE
            east = (longitude - self._last[1]) * _METRES_PER_DEGREE * math.cos(math.radians(latitude))
            step = math.hypot(north, east)
            if step >= _JITTER:
                self._last = latitude, longitude
                self._metres += step if step <= _JUMP else 0.0
        return None if self._last is None else self._metres
