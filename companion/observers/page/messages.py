"""Defines what supervisor and web process say to each other: one datagram (SOCK_SEQPACKET) a message.

To the web process: a kind (one byte), a JSON object, and for a picture a line feed and the JPEG. From it: one
byte, and for an answer when it was handed over (monotonic seconds) and the payload of a TUNNEL 45003. The web
process talks to browsers, so the supervisor believes nothing else of it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from enum import Enum
from typing import Any, NamedTuple

from companion.wire.answers import MAX_PAYLOAD

LARGEST = 192 << 10
"""Bytes of a message: as much as the kernel's default buffers take. A picture of 480 pixels needs a third."""


class PageMessageKind(Enum):
    """What is told to the web process."""

    SETUP = b"c"
    """The first message: folder, token_hash, own_address: where only this computer reaches it, else ""."""
    NEWS = b"n"
    """The documents status, state and check, `told`: what the ground is told, `ahead`: of `Status.ahead`,
    and `at`: when it was so."""
    ACKNOWLEDGEMENT = b"k"
    """payload: of a TUNNEL 45004, in hexadecimal: the result of an answer that was given on the page."""
    PICTURE = b"p"
    """frame: its id. at: when it was captured. Each `at` is in seconds of the monotonic clock, which both
    processes share: a message may have waited for a process that was stopped."""


ALIVE, WANTED, ANSWER = b"a", b"w", b"r"
"""From the web process: it lives; somebody watches, so that a picture should be drawn; an answer."""
_AT = struct.Struct("<d")
LONGEST_SAID = len(ANSWER) + _AT.size + MAX_PAYLOAD
"""Bytes of what the web process says."""


def encode_answer(payload: bytes, now: float) -> bytes:
    """Encode an answer for the supervisor. payload: of a TUNNEL 45003. now: monotonic seconds."""
    return ANSWER + _AT.pack(now) + payload


def decode_answer(said: bytes) -> tuple[bytes, float] | None:
    """Return the payload of an answer and when it was handed over; None for anything else."""
    start = len(ANSWER) + _AT.size
    if not said.startswith(ANSWER) or not start <= len(said) <= LONGEST_SAID:
        return None
    return said[start:], float(_AT.unpack_from(said, len(ANSWER))[0])


class PageMessage(NamedTuple):
    """A message to the web process. picture: JPEG, b"" for the other kinds."""

    kind: PageMessageKind
    content: Mapping[str, Any]
    picture: bytes = b""

    def encoded(self) -> bytes:
        """Encode it. Raises ValueError when it is too long, or is not JSON."""
        text = json.dumps(self.content, separators=(",", ":"), allow_nan=False).encode()
        packed = (
            b"\n".join([self.kind.value + text, self.picture]) if self.picture else self.kind.value + text
        )
        if len(packed) > LARGEST:
            raise ValueError(f"{len(packed)} bytes, at most {LARGEST} are sent")
        return packed


def decode(packed: bytes) -> PageMessage:
    """Decode a message. Raises ValueError for any other bytes."""
    text, _, picture = packed[1:].partition(b"\n")
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(content, dict):
        raise ValueError("no JSON object")
    return PageMessage(PageMessageKind(packed[:1]), content, picture)
