"""Converts where something was to JSON values and back."""

from __future__ import annotations

from typing import Any, Protocol

from companion.wire.json_values import mapping_of, number_of

_ANGLES = ("roll", "pitch", "yaw")
_DIGITS = {"latitude": 7, "longitude": 7}
_MOST = {"latitude": 90.0, "longitude": 180.0, "time": 1e11}
"""Greatest values; 360 of the other angles."""


class _Placed(Protocol):
    """What a `Place` has, which itself is too heavy for the ground."""

    @property
    def latitude(self) -> float | None: ...
    @property
    def longitude(self) -> float | None: ...
    @property
    def heading(self) -> float | None: ...
    @property
    def time(self) -> float | None: ...
    @property
    def attitude(self) -> tuple[float, float, float] | None: ...


def place_document(place: _Placed) -> dict[str, float]:
    """Return what is known of a place as JSON values.

    Angles are in degrees; latitude and longitude have 7 digits, about 1 cm. time: seconds since 1970.
    """
    named = {
        "latitude": place.latitude,
        "longitude": place.longitude,
        "heading": place.heading,
        **dict(zip(_ANGLES, place.attitude or (), strict=False)),
        "time": place.time,
    }
    return {name: round(value, _DIGITS.get(name, 2)) for name, value in named.items() if value is not None}


def place_attributes(raw: Any) -> dict[str, Any]:
    """Return the attributes of a `Place` from what `place_document` made, None for those out of range."""
    told = mapping_of(raw)

    def figure(name: str) -> float | None:
        most = _MOST.get(name, 360.0)
        return number_of(told.get(name), -most, most)

    roll, pitch, yaw = map(figure, _ANGLES)
    known = roll is not None and pitch is not None and yaw is not None
    found: dict[str, Any] = {name: figure(name) for name in ("latitude", "longitude", "heading", "time")}
    return found | {"attitude": (roll, pitch, yaw) if known else None}
