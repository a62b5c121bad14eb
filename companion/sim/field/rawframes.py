"""Makes frames as ArduPilot hands them to its scripts: mavlink_message_t structures that nobody has checked.

The layout is that of mavlink_types.h of the MAVLink C library: checksum, magic, length, both flags, sequence,
system, component, 24 bits of message id, 33 x 8 bytes of payload, checksum bytes and signature; 291 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

V1, V2 = 0xFE, 0xFD
SIGNED = 1
SIGNATURE = 13
PAYLOAD = 264
_CHECKSUM = 2


def raw_frames(datagram: bytes) -> Iterator[tuple[int, bytes]]:
    """Yields (message id, structure) of every whole frame in `datagram`, even with a wrong checksum.

    Bytes that belong to no frame are skipped; a frame that is cut off at the end is dropped.
    """
    at = 0
    while at < len(datagram):
        frame = _frame(datagram, at)
        if frame is None:
            at += 1
            continue
        number, structure, size = frame
        yield number, structure
        at += size


def _frame(datagram: bytes, at: int) -> tuple[int, bytes, int] | None:
    magic = datagram[at]
    header = {V1: 6, V2: 10}.get(magic)
    if header is None or len(datagram) < at + header + _CHECKSUM:
        return None
    length = datagram[at + 1]
    incompatible = compatible = 0
    if magic == V2:
        incompatible, compatible, sequence, system, component = datagram[at + 2 : at + 7]
        number = int.from_bytes(datagram[at + 7 : at + 10], "little")
    else:
        sequence, system, component, number = datagram[at + 2 : at + 6]
    end = at + header + length
    size = header + length + _CHECKSUM + (SIGNATURE if incompatible & SIGNED else 0)
    if len(datagram) < at + size:
        return None
    checksum = datagram[end : end + _CHECKSUM]
    fields = struct.pack(
        "<2sBBBBBBB3s",
        *(checksum, magic, length, incompatible, compatible, sequence, system, component),
        number.to_bytes(3, "little"),
    )
    payload = datagram[at + header : end].ljust(PAYLOAD, b"\0")
    signature = datagram[end + _CHECKSUM : at + size].ljust(SIGNATURE, b"\0")
    return number, fields + payload + checksum + signature, size
