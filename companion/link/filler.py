"""Ends frames that were cut, so that the other end finds the next one."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

_LONGEST_FRAME = 280
FILLER = bytes(_LONGEST_FRAME - 1)
"""Zeros, no beginning of a frame. A parser that has begun a frame waits for the length that it claims."""


def completes(frame: bytes) -> bool:
    """Whether FILLER makes a valid frame of a part of `frame`, so that cutting it would not destroy it."""
    mav = mavlink.MAVLink(None)
    for cut in range(1, len(frame)):
        try:
            mav.decode(bytearray(frame[:cut].ljust(len(frame), b"\0")))
        except mavlink.MAVError:
            continue
        return True
    return False
