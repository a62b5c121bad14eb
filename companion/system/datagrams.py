"""Frames what supervisor and side processes say to each other: one datagram (SOCK_SEQPACKET) a message.

A kind (one byte), a JSON object unless it is empty, and where bytes follow a line feed and those. Of the
bytes that a process sends nothing is believed: `decode` refuses what is no such message, and whoever takes it
checks the values.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

LARGEST = 192 << 10
"""Bytes of a message: as much as the kernel's default buffers take. A picture of 480 pixels needs a third."""
_NOTHING: Mapping[str, Any] = MappingProxyType({})


class Datagram(NamedTuple):
    """A message. data: such as a JPEG, b"" for none."""

    kind: bytes
    content: Mapping[str, Any] = _NOTHING
    data: bytes = b""

    def encoded(self) -> bytes:
        """Encode it. Raises ValueError when it is too long, or is not JSON."""
        text = json.dumps(self.content, separators=(",", ":"), allow_nan=False) if self.content else ""
        packed = self.kind + text.encode() + (b"\n" + self.data if self.data else b"")
        if len(packed) > LARGEST:
            raise ValueError(f"{len(packed)} bytes, at most {LARGEST} are sent")
        return packed


def decode(packed: bytes) -> Datagram:
    """Decode a message. Raises ValueError for any other bytes."""
    text, _, data = packed[1:].partition(b"\n")
    try:
        content = json.loads(text or b"{}")
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not packed or not isinstance(content, dict):
        raise ValueError("no kind, or no JSON object")
    return Datagram(packed[:1], content, data)
