"""Checks values of JSON that came from elsewhere: one that is missing or of another kind counts as none.

Converts where something was to such values and back.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Protocol

from anytraverse.errors import AnyTraverseError
from anytraverse.preferences import MAX_WORDS, check_weight, clean_word
from companion.wire.packing import Fractions, box_to_u16

LONGEST = 300
"""Characters of a text."""
LARGEST = 256 << 10
"""Bytes of a document: several times what a rover writes, and read in some 30 ms whatever it holds."""
_ANGLES = ("roll", "pitch", "yaw")
_DIGITS = {"latitude": 7, "longitude": 7}
_MOST = {"latitude": 90.0, "longitude": 180.0, "time": 1e11}
"""Greatest values; 360 of the other angles."""


class DocumentError(ValueError):
    """Reports a document that is none; the text says what it is instead."""


def read_object(content: bytes, what: str = "it") -> Mapping[str, Any]:
    """Read a JSON object. what: names it in an error. Raises DocumentError."""
    if len(content) > LARGEST:
        raise DocumentError(f"{what} is longer than {LARGEST >> 10} kB")
    try:
        told = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{what} is not JSON") from error
    if not isinstance(told, dict):
        raise DocumentError(f"{what} is not an object")
    return told


def mapping_of(raw: Any) -> Mapping[str, Any]:
    """Return an object, {} for anything else."""
    return raw if isinstance(raw, dict) else {}


def list_of(raw: Any) -> list[Any]:
    """Return a list, [] for anything else."""
    return raw if isinstance(raw, list) else []


def text_of(raw: Any) -> str:
    """Return the first `LONGEST` characters of a text, "" for anything else."""
    return raw[:LONGEST] if isinstance(raw, str) else ""


def number_of(raw: Any, low: float, high: float) -> float | None:
    """Return a number of low..high, None for anything else."""
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        return None
    return float(raw) if low <= raw <= high and math.isfinite(raw) else None


def whole_of(raw: Any, low: float, high: float) -> int | None:
    """Return a number of low..high without its fraction, None for anything else."""
    number = number_of(raw, low, high)
    return None if number is None else int(number)


def box_of(raw: Any) -> Fractions | None:
    """Return a list of left, top, right and bottom as a box, None for anything else."""
    sides = [number_of(one, 0, 1) for one in list_of(raw)]
    known = [one for one in sides if one is not None]
    if len(known) != 4 or len(sides) != 4:
        return None
    box = known[0], known[1], known[2], known[3]
    left, top, right, bottom = box_to_u16(box)  # as fine as it is sent
    return box if left < right and top < bottom else None


def word_of(raw: Any) -> str:
    """Return a word as it is written, "" for anything else."""
    try:
        return clean_word(raw) if isinstance(raw, str) else ""
    except AnyTraverseError:
        return ""


def weights_of(raw: Any, most: int = MAX_WORDS) -> dict[str, float]:
    """Return the weights by word of the first `most` members of an object, without those that are none."""
    found = {}
    for name, value in list(mapping_of(raw).items())[:most]:
        word, weight = word_of(name), number_of(value, -1, 1)
        if word and weight is not None:
            found[word] = check_weight(word, weight)
    return found


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
