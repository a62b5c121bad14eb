"""Defines what the live view's process says to the supervisor."""

from __future__ import annotations

import struct
from typing import NamedTuple

_REPORT = struct.Struct("<HH")
LONGEST_REPORT = _REPORT.size


class LiveReport(NamedTuple):
    """Tells how the live view goes. port: where it listens. clients: viewers that see at least one topic."""

    port: int
    clients: int

    def encoded(self) -> bytes:
        """Encode it for the supervisor."""
        return _REPORT.pack(self.port, min(self.clients, 0xFFFF))

    @classmethod
    def decoded(cls, packed: bytes) -> LiveReport:
        """Decode it. Raises ValueError for any other bytes."""
        if len(packed) != _REPORT.size or packed[:2] == b"\0\0":
            raise ValueError("no report")
        return cls(*_REPORT.unpack(packed))
