"""Parses bytes into MAVLink messages. Noise costs at most the frame that it hit."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

_V1 = 254
_V2 = 253
_SIGNED = 1
_SIGNATURE = 13
PATIENCE = 1.5
"""s for the rest of a frame; the longest takes 1.2 s at 2400 baud."""
MAX_BROKEN = 64
"""Broken frames that one `feed` examines: each may cost the checksum of a long frame."""


class Parser:
    """Finds frames with a correct checksum in a stream or in datagrams.

    pymavlink's own parser skips the whole length that a broken frame claims, and good frames inside it.

    bad: broken frames so far. behind: whether received bytes still wait to be parsed.
    """

    def __init__(self) -> None:
        self._mav = mavlink.MAVLink(None)
        self._buffer = bytearray()
        self._arrived_at: list[float] = []
        """When each byte of the buffer arrived, s."""
        self.bad = 0
        self.behind = False

    def forget(self) -> None:
        """Discard the buffer: the bytes before and after a reconnect do not belong together."""
        self._buffer.clear()
        self._arrived_at.clear()
        self.behind = False

    def feed(self, data: bytes, now: float, *, whole: bool) -> list[Any]:
        """Return the messages that are complete now, of ids that the dialect knows.

        whole: `data` is a datagram, so an incomplete frame at its end is discarded. In a stream, a frame
        counts as broken when it is incomplete 1.5 s after its start: noise that looks like the head of a long
        frame would otherwise delay the frames behind it. After 64 broken frames the rest of a datagram is
        dropped; a stream is `behind`: call again with b"" to go on. Broken frames are counted in `bad`.
        """
        enough = self.bad + MAX_BROKEN
        expired = bisect_left(self._arrived_at, now - PATIENCE)
        self._buffer += data
        self._arrived_at += [now] * len(data)
        messages = []
        at = 0
        while (at := self._marker(at)) < len(self._buffer) and self.bad < enough:
            length = self._length(at)
            if length is None or at + length > len(self._buffer):
                if at >= expired:
                    break
                self.bad += 1
                at += 1
                continue
            message = self._decode(self._buffer[at : at + length])
            unknown = message is not None and message.get_msgId() < 0
            if unknown and not whole and at + length == len(self._buffer):
                break  # wait for the next byte, which tells a frame of unknown id from noise
            if message is None or (unknown and not self._begins(at + length)):
                self.bad += 1
                at += 1
                continue
            at += length
            if not unknown:
                messages.append(message)
        done = len(self._buffer) if whole else at
        self.behind = done < len(self._buffer) and self.bad >= enough
        del self._buffer[:done], self._arrived_at[:done]
        return messages

    def _marker(self, start: int) -> int:
        found = [at for at in (self._buffer.find(_V1, start), self._buffer.find(_V2, start)) if at >= 0]
        return min(found, default=len(self._buffer))

    def _length(self, at: int) -> int | None:
        head = self._buffer[at : at + 3]
        if len(head) < 3:
            return None
        if head[0] == _V1:
            return 8 + head[1]
        return 12 + head[1] + (_SIGNATURE if head[2] & _SIGNED else 0)

    def _begins(self, at: int) -> bool:
        """Whether a frame may begin here.

        The checksum of an unknown id cannot be verified, and most such frames are noise. So one passes only
        when another frame follows it.
        """
        return at == len(self._buffer) or self._buffer[at] in (_V1, _V2)

    def _decode(self, frame: bytearray) -> Any | None:
        """Decode a whole frame; None when it is broken, or has incompatibility flags that we do not know."""
        if frame[0] == _V2 and frame[2] & ~_SIGNED:
            return None
        try:
            return self._mav.decode(frame)
        except mavlink.MAVError:
            return None
