"""Packs a message as it leaves its sender."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink


def framed(message: Any, system: int, component: int) -> bytes:
    """Returns a message's MAVLink 2 frame, unsigned, with sequence number 0."""
    return bytes(message.pack(mavlink.MAVLink(None, system, component)))
