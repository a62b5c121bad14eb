"""A place as JSON values, for the journal and for the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from anytraverse.history import Place

_ANGLES = ("roll", "pitch", "yaw")


def place_figures(place: Place) -> dict[str, float]:
    """What is known of it: degrees, to about 1 cm; time in seconds since 1970."""
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
    """What `place_figures` made; nothing is known of anything else."""
    if not isinstance(saved, Mapping):
        return Place()
    found = {name: float(value) for name, value in saved.items() if _is_figure(value)}
    roll, pitch, yaw = (found.get(name) for name in _ANGLES)
    attitude = None if roll is None or pitch is None or yaw is None else (roll, pitch, yaw)
    latitude, longitude, heading = (found.get(name) for name in ("latitude", "longitude", "heading"))
    return Place(latitude, longitude, heading, found.get("time"), attitude)


def _is_figure(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
