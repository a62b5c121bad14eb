"""Converts a place to JSON values and back, and measures how far the vehicle has driven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from anytraverse.history import Place

_ANGLES = ("roll", "pitch", "yaw")


def place_figures(place: Place) -> dict[str, float]:
    """Return what is known of a place as JSON values.

    Angles are in degrees; latitude and longitude have 7 digits, about 1 cm. time: seconds since 1970.
    """
    angles = dict(zip(_ANGLES, place.attitude or (), strict=False))
    named = {
        "latitude": place.latitude,
        "longitude": place.longitude,
        "heading": place.heading,
        **angles,
        "time": place.time,
    }
    digits = {"latitude": 7, "longitude": 7}
    return {name: round(value, digits.get(name, 2)) for name, value in named.items() if value is not None}


def read_place(saved: Any) -> Place:
    """Read what `place_figures` made. Values that are missing or not finite numbers are left unknown."""
    if not isinstance(saved, Mapping):
        return Place()
    found = {name: float(value) for name, value in saved.items() if _is_figure(value)}
    roll, pitch, yaw = (found.get(name) for name in _ANGLES)
    attitude = None if roll is None or pitch is None or yaw is None else (roll, pitch, yaw)
    latitude, longitude, heading = (found.get(name) for name in ("latitude", "longitude", "heading"))
    return Place(latitude, longitude, heading, found.get("time"), attitude)


def _is_figure(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


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
