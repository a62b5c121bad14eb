"""One request heard on two connections has effect once."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

WITHIN = 1.0
MAX_REMEMBERED = 512
"""More than are admitted within a second, whoever asks."""
_HEADER_1, _HEADER_2 = 6, 10


class Repeats:
    """Knows the newest requests. The same one again on the same connection is a wish of its own."""

    def __init__(self) -> None:
        self._heard: OrderedDict[tuple[int, int, int, bytes], tuple[str, float]] = OrderedDict()

    def is_repeated(self, message: Any, connection: str, now: float) -> bool:
        """Whether its sender said just that within the last second on another connection."""
        before, at = self._heard.get(_key(message), (connection, now))
        return before != connection and now - at <= WITHIN

    def keep(self, message: Any, connection: str, now: float) -> None:
        """It was admitted."""
        key = _key(message)
        self._heard[key] = (connection, now)
        self._heard.move_to_end(key)
        if len(self._heard) > MAX_REMEMBERED:
            self._heard.popitem(last=False)


def _key(message: Any) -> tuple[int, int, int, bytes]:
    """Payload less the zeros at its end, which MAVLink 2 leaves out and MAVLink 1 does not."""
    frame = message.get_msgbuf()
    start = _HEADER_1 if frame[0] == mavlink.PROTOCOL_MARKER_V1 else _HEADER_2
    payload = bytes(frame[start : start + frame[1]]).rstrip(b"\0")
    return message.get_srcSystem(), message.get_srcComponent(), message.get_msgId(), payload
