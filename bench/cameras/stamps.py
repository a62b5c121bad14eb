"""Writes the time into a picture and reads it again, so that its true age is known after any codec.

Only the standard library is imported: the RTSP server runs under the system's own Python, without numpy.
"""

from __future__ import annotations

BITS = 32
_BAND = 0.25
"""Share of the picture's height that the time takes, at its upper side."""


def stamped(width: int, height: int, now: float, channels: int = 1) -> bytes:
    """Make a grey picture whose upper band shows `now` in ms, as black and white cells.

    now: s of time.monotonic(). Returns height x width x channels bytes. Below it, stripes move.
    """
    stamp = round(1e3 * now) & 0xFFFFFFFF
    cell = width // BITS
    row = b"".join((b"\xeb" if stamp >> bit & 1 else b"\x10") * cell for bit in range(BITS))
    row = row.ljust(width, b"\x10")
    top = round(_BAND * height)
    shift = stamp // 20 % 64
    stripes = (bytes(range(60, 188, 2)) * (width // 64 + 2))[shift : shift + width]
    plane = row * top + stripes * (height - top)
    return plane if channels == 1 else bytes(level for level in plane for _ in range(channels))


def age(levels: bytes | memoryview, width: int, height: int, now: float) -> float:
    """Return the s from the time that a grey picture shows until `now`. levels: height x width bytes."""
    cell = width // BITS
    middle = round(_BAND * height) // 2 * width + cell // 2
    stamp = sum((levels[middle + bit * cell] > 125) << bit for bit in range(BITS))
    difference = (round(1e3 * now) - stamp) & 0xFFFFFFFF
    return (difference - (1 << 32) if difference >> 31 else difference) / 1e3
