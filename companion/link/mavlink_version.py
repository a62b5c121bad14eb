"""MAVLink 1 or 2: in which of them a connection is spoken to, and frames of either."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

PATIENCE = 10.0
PROBE_PERIOD = 10.0
_LAST_ID = 255
_PLAIN_LENGTH = {
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: 3,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: 51,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: 60,
}
"""Payload bytes before the extensions, which MAVLink 1 does not know."""


class MavlinkVersion:
    """Version 1 once nothing but it has been heard for 10 s, else 2. The first frame of 2 changes back.

    An autopilot that begins in 1 and changes over when it hears 2 needs to hear some: while we speak 1, a
    heartbeat goes out as 2 every 10 s.
    """

    def __init__(self) -> None:
        self._alone_since: float | None = None
        self._probe_at = 0.0
        self.is_1 = False

    def forget(self) -> None:
        """The device was opened anew: who knows what is at its other end now."""
        self._alone_since, self.is_1 = None, False

    def hear(self, message: Any, now: float) -> None:
        """A message of somebody else came."""
        if message.get_msgbuf()[0] != mavlink.PROTOCOL_MARKER_V1:
            self.forget()
        elif self._alone_since is None:
            self._alone_since = now
        elif not self.is_1 and now - self._alone_since >= PATIENCE:
            self.is_1, self._probe_at = True, now + PROBE_PERIOD

    def packs_1(self, name: str, now: float) -> bool:
        """Whether a message of the table's row `name` goes out as version 1."""
        return self.is_1 and not (name == "heartbeat" and now >= self._probe_at)

    def told(self, frame: bytes, now: float) -> None:
        """`frame` left."""
        if frame[0] != mavlink.PROTOCOL_MARKER_V1:
            self._probe_at = now + PROBE_PERIOD


def fits_1(message: Any) -> bool:
    """Whether version 1 has a place for this message's id."""
    return bool(message.get_msgId() <= _LAST_ID)


def pack_1(message: Any, mav: Any) -> bytes:
    """A frame of version 1, without what is an extension of version 2."""
    packed = bytes(message.pack(mav, force_mavlink1=True))
    plain = _PLAIN_LENGTH.get(message.get_msgId())
    if plain is None:
        return packed
    payload = bytes(message.get_payload()[:plain])
    return bytes(message._pack(mav, message.crc_extra, payload, force_mavlink1=True))
