"""Packs fixed-point numbers, boxes and short texts into payloads, and unpacks them with checks."""

from __future__ import annotations

import math
import struct

UNKNOWN_U16 = 0xFFFF
UNKNOWN_I16 = -0x8000
_SCALE = 10_000
_LONG_WORD = 16

Fractions = tuple[float, float, float, float]
"""A box: left, top, right, bottom as fractions in [0, 1]."""


class PayloadError(ValueError):
    """A payload cannot be unpacked or packed: cut off, of another version, out of range, or too long."""


def fraction_to_u16(value: float | None) -> int:
    """Encode a number in [0, 1] in steps of 1e-4; None or not finite becomes 65535."""
    if value is None or not math.isfinite(value):
        return UNKNOWN_U16
    return round(min(1.0, max(0.0, value)) * _SCALE)


def u16_to_fraction(raw: int) -> float | None:
    """Decode a number in [0, 1], None for 65535. Raises PayloadError above 1."""
    if raw == UNKNOWN_U16:
        return None
    if raw > _SCALE:
        raise PayloadError(f"fraction {raw} is above {_SCALE}")
    return raw / _SCALE


def signed_to_i16(value: float | None) -> int:
    """Encode a number in [-1, 1] in steps of 1e-4; None or not finite becomes -32768."""
    if value is None or not math.isfinite(value):
        return UNKNOWN_I16
    return round(min(1.0, max(-1.0, value)) * _SCALE)


def i16_to_signed(raw: int) -> float | None:
    """Decode a number in [-1, 1], None for -32768. Raises PayloadError outside [-1, 1]."""
    if raw == UNKNOWN_I16:
        return None
    if not -_SCALE <= raw <= _SCALE:
        raise PayloadError(f"value {raw} is outside +-{_SCALE}")
    return raw / _SCALE


def box_to_u16(box: Fractions | None) -> tuple[int, int, int, int]:
    """Encode a box as four fractions; None becomes four times 65535."""
    if box is None:
        return (UNKNOWN_U16,) * 4
    left, top, right, bottom = box
    return fraction_to_u16(left), fraction_to_u16(top), fraction_to_u16(right), fraction_to_u16(bottom)


def u16_to_box(raw: tuple[int, int, int, int]) -> Fractions | None:
    """Decode a box, None for four times 65535. Raises PayloadError for an empty box."""
    if all(side == UNKNOWN_U16 for side in raw):
        return None
    sides = [u16_to_fraction(side) for side in raw]
    left, top, right, bottom = sides
    if left is None or top is None or right is None or bottom is None or left >= right or top >= bottom:
        raise PayloadError(f"{raw} is no box")
    return left, top, right, bottom


def text_to_bytes(text: str, limit: int) -> bytes:
    """Encode `text` as a length byte and UTF-8, cut between characters to at most `limit` bytes."""
    encoded = text.encode()[:limit].decode(errors="ignore").encode()
    return bytes([len(encoded)]) + encoded


def shortened(text: str, limit: int) -> str:
    """Shorten `text` to at most `limit` bytes of UTF-8, with "..." at the end.

    It is cut behind a whole word, unless that would drop more than 16 bytes of a long one.
    """
    if len(text.encode()) <= limit:
        return text
    kept = text.encode()[: limit - 3].decode(errors="ignore")
    whole, _, rest = kept.rpartition(" ")
    return (whole if len(rest.encode()) <= _LONG_WORD and whole else kept).rstrip(" ,") + "..."


class Reader:
    """Reads fields from the front of a payload; raises PayloadError when it is too short."""

    def __init__(self, payload: bytes) -> None:
        self._rest = payload

    def take(self, layout: struct.Struct) -> tuple[int, ...]:
        """Read the next fields, of `layout`."""
        if len(self._rest) < layout.size:
            raise PayloadError(f"payload ends {layout.size - len(self._rest)} bytes early")
        fields = layout.unpack_from(self._rest)
        self._rest = self._rest[layout.size :]
        return fields

    def text(self) -> str:
        """Read the next text: a length byte and UTF-8."""
        if not self._rest or len(self._rest) < 1 + self._rest[0]:
            raise PayloadError("text is cut off")
        encoded, self._rest = self._rest[1 : 1 + self._rest[0]], self._rest[1 + self._rest[0] :]
        try:
            return encoded.decode()
        except UnicodeDecodeError as error:
            raise PayloadError("text is not UTF-8") from error

    def end(self) -> None:
        """Raise PayloadError when bytes are left."""
        if self._rest:
            raise PayloadError(f"{len(self._rest)} bytes too many")


def clean(text: str) -> str:
    """Replace unprintable characters in received text: they could control the terminal."""
    return "".join(character if character.isprintable() else " " for character in text).strip()


_EDGE = 0.02
"""Fraction of the picture's width within which a box is at its edge: more of the thing may lie outside."""


def where(box: Fractions) -> str:
    """Word in which third of the picture the middle of a box is, or at which edge of the picture it lies."""
    left, right = box[0] <= _EDGE, box[2] >= 1 - _EDGE
    if left != right:
        return "at the left edge" if left else "at the right edge"
    middle = (box[0] + box[2]) / 2
    return "at the left" if middle < 1 / 3 else "at the right" if middle > 2 / 3 else "in the middle"
