"""Signs MAVLink 2 frames, and checks their signatures and timestamps. No I/O, no clock.

A signature is link id (u8), timestamp (48 bit, 10 us since 2015) and the first 48 bits of
SHA-256(key, header, payload, checksum, link id, timestamp).
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, NoReturn

from pymavlink.generator.mavcrc import x25crc

BLOCK = 13
"""Bytes that a signature adds to a frame."""
KEY_BYTES = 32
TICKS = 100_000
"""Ticks per second: timestamps count units of 10 us."""
EPOCH = 1_420_070_400
"""Zero of the timestamps, 2015-01-01 UTC, in s since 1970."""
LAST = (1 << 48) - 1
MINUTE = 60 * TICKS
DAY = 24 * 60 * MINUTE
"""How far the first frame of a stream may be ahead of a clock that the network set."""
FARTHEST_AHEAD = 366 * DAY
"""How far a verified frame may be ahead of a clock that counts as right."""
MAX_STREAMS = 64

UNSIGNED: Final = "unsigned"
SIGNATURE: Final = "signature"
REPLAY: Final = "replay"
AHEAD: Final = "ahead"
"""Why a frame is refused: no signature; not our key; not newer than those received; too far ahead of us."""

FrameRefusal = Literal["", "unsigned", "signature", "replay", "ahead"]

_V2 = 0xFD
_SIGNED = 1
_CHECKSUM = 2
_HEADER = 10


class SignedStream(NamedTuple):
    """A source of signed frames. Each stream has its own timestamps."""

    system: int
    component: int
    link: int


def ticks(unix: float) -> int:
    """Convert s since 1970 to a timestamp; 0 before 2015."""
    return min(LAST, max(0, int((unix - EPOCH) * TICKS)))


def is_signed(frame: bytes) -> bool:
    """Whether a whole frame claims to carry a signature."""
    return len(frame) >= _HEADER + _CHECKSUM + BLOCK and frame[0] == _V2 and bool(frame[2] & _SIGNED)


def stream_of(frame: bytes) -> SignedStream:
    """The stream that a signed frame claims; it may be forged until the frame is verified."""
    return SignedStream(frame[5], frame[6], frame[-BLOCK])


def timestamp_of(frame: bytes) -> int:
    """The timestamp that a signed frame claims; it may be forged until the frame is verified."""
    return int.from_bytes(frame[1 - BLOCK : 7 - BLOCK], "little")


class SigningKey:
    """Holds 32 secret bytes, which can be used but not read: neither repr nor pickle shows them."""

    __slots__ = ("_seeded",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes")
        self._seeded = hashlib.sha256(secret)

    def __repr__(self) -> str:
        return "SigningKey(secret)"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a signing key is not copied")

    @property
    def fingerprint(self) -> str:
        """8 hex digits by which a person distinguishes keys."""
        return self._signature(b"fingerprint").hex()[:8]

    def sign(self, frame: bytes, crc_extra: int, link: int, timestamp: int) -> bytes:
        """Sign a packed, unsigned MAVLink 2 frame. Raises ValueError for any other frame."""
        if len(frame) < _HEADER + _CHECKSUM or frame[0] != _V2 or frame[2] & _SIGNED:
            raise ValueError("only an unsigned MAVLink 2 frame can be signed")
        body = frame[1:2] + bytes([frame[2] | _SIGNED]) + frame[3:-_CHECKSUM]
        checksum = x25crc(body)
        checksum.accumulate(bytes([crc_extra]))
        signed = frame[:1] + body + struct.pack("<HB", checksum.crc, link) + timestamp.to_bytes(6, "little")
        return signed + self._signature(signed)

    def signed(self, frame: bytes) -> bool:
        """Whether a signed frame's signature was made with this key."""
        return hmac.compare_digest(self._signature(frame[:-6]), bytes(frame[-6:]))

    def _signature(self, signed: bytes) -> bytes:
        digest = self._seeded.copy()
        digest.update(signed)
        return digest.digest()[:6]


class Timestamps:
    """Stores the newest timestamp of each stream, and `last`, the newest of all. They only rise.

    floor: a stream that is not stored must be above it. It is the newest timestamp of the streams that were
    dropped, because at most 64 are stored.
    """

    def __init__(
        self, last: int = 0, floor: int = 0, streams: Mapping[SignedStream, int] | None = None
    ) -> None:
        self.last = last
        self.floor = floor
        self._streams = dict(streams or {})

    @property
    def streams(self) -> Mapping[SignedStream, int]:
        """Stream -> its newest timestamp."""
        return self._streams

    def next(self, stream: SignedStream, clock: int) -> int:
        """The timestamp for the next frame of our own `stream`. It is stored, so that an echo is refused."""
        self.last = min(LAST, max(clock, self.last + 1))
        self._note(stream, self.last)
        return self.last

    def check(
        self, stream: SignedStream, timestamp: int, clock: int | None, *, synchronised: bool = False
    ) -> FrameRefusal:
        """Check and store the timestamp of a verified frame; return why it is refused, "" when accepted.

        clock: our time, None while it is not known: then only the stored timestamps count. synchronised:
        whether the network set it. Then it alone judges a new stream: one sender whose clock is ahead must
        not make all others old.
        """
        ours, farthest, floor = max(clock or 0, self.last), FARTHEST_AHEAD, self.floor
        known = self._streams.get(stream)
        if known is None and clock is not None and synchronised:
            ours, farthest, floor = clock, DAY, min(floor, clock)
        if timestamp <= (floor if known is None else known):
            return REPLAY
        if known is None and timestamp + MINUTE < ours:
            return REPLAY
        if clock is not None and timestamp > ours + farthest:
            return AHEAD
        self._note(stream, timestamp)
        self.last = max(self.last, timestamp)
        return ""

    def _note(self, stream: SignedStream, timestamp: int) -> None:
        if stream not in self._streams and len(self._streams) >= MAX_STREAMS:
            # The oldest timestamp, not the one heard longest ago: its frames could be replayed.
            forgotten = min(self._streams, key=self._streams.__getitem__)
            self.floor = max(self.floor, self._streams.pop(forgotten))
        self._streams[stream] = timestamp


def refusal(
    frame: bytes, key: SigningKey, timestamps: Timestamps, clock: int | None, *, synchronised: bool = False
) -> FrameRefusal:
    """Why a whole frame is refused, "" when accepted. The timestamp is checked only after the signature.

    clock, synchronised: as of `Timestamps.check`.
    """
    if not is_signed(frame):
        return UNSIGNED
    if not key.signed(frame):
        return SIGNATURE
    return timestamps.check(stream_of(frame), timestamp_of(frame), clock, synchronised=synchronised)
