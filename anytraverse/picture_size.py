"""Reads a picture's size from the header of its file, without NumPy and in bounded time."""

from __future__ import annotations

import struct
from typing import Any

_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # JPEG markers SOF0 to SOF15
_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xD9)})  # JPEG markers TEM, RST0 to RST7 and SOI
_TIFF_WIDTHS, _TIFF_HEIGHTS = (256, 322), (257, 323)
_MOST_MARKERS = 1000
"""JPEG markers and fill bytes that are read to find the size: a file could have millions."""


def picture_size(content: bytes) -> tuple[int, int] | None:
    """Read (width, height) from the header; None for what is not a PNG, JPEG, BMP, WebP or TIFF file."""
    try:
        if content[:8] == b"\x89PNG\r\n\x1a\n" and content[12:16] == b"IHDR":
            return _pair(">II", content, 16)
        if content[:2] == b"\xff\xd8":
            return jpeg_size(content)
        if content[:2] == b"BM":
            old = struct.unpack_from("<I", content, 14)[0] == 12
            width, height = _pair("<HH" if old else "<ii", content, 18)
            return abs(width), abs(height)
        if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
            return _webp(content)
        if content[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(content)
    except struct.error:  # the file ends within its header
        pass
    return None


def jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Read (width, height) from a JPEG's frame header (ITU-T T.81, B.2.2); None for what is no JPEG."""
    if content[:2] != b"\xff\xd8":
        return None
    try:
        return _frame_size(content)
    except struct.error:  # the file ends within its header
        return None


def _frame_size(content: bytes) -> tuple[int, int] | None:
    at = 2
    for _ in range(_MOST_MARKERS):
        if (at := content.find(b"\xff", at)) < 0:
            return None
        (marker,) = struct.unpack_from("B", content, at + 1)
        if marker in _FRAME_HEADERS:
            height, width = _pair(">HH", content, at + 5)
            return width, height
        if marker == 0xFF:
            at += 1
        elif marker == 0 or marker in _WITHOUT_LENGTH:
            at += 2
        elif marker in (0xD9, 0xDA):  # end of image or start of scan, and no size came before
            return None
        else:
            at += 2 + max(2, struct.unpack_from(">H", content, at + 2)[0])
    return None


def _pair(form: str, content: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(form, content, at)
    return first, second


def _webp(content: bytes) -> tuple[int, int] | None:
    kind = content[12:16]
    if kind == b"VP8X":
        low, high = struct.unpack_from("<IH", content, 24)
        return 1 + (low & 0xFFFFFF), 1 + (low >> 24 | high << 8)
    if kind == b"VP8 ":
        width, height = _pair("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return None


def _tiff(content: bytes) -> tuple[int, int] | None:
    """Return the larger of the picture's size and a tile's: the decoder allocates either as a whole."""
    order = "<" if content[:2] == b"II" else ">"
    (at,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, at)
    found: dict[int, int] = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = _pair(f"{order}HH", content, entry)
        if tag in _TIFF_WIDTHS + _TIFF_HEIGHTS:
            value: Any = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", content, entry + 8)[0]
            found[tag] = max(found.get(tag, 0), value)
    width = max(found.get(tag, 0) for tag in _TIFF_WIDTHS)
    height = max(found.get(tag, 0) for tag in _TIFF_HEIGHTS)
    return (width, height) if width and height else None
