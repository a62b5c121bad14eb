"""Signing on the operator's side: what leaves is signed, what arrives unsigned or old is not shown."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from companion.wire import signing as wire
from companion.wire.signing import SigningKey, Stream, Timestamps

MAX_PROBLEMS = 8
_RADIO = frozenset({"RADIO", "RADIO_STATUS"})
_WHY = {
    wire.UNSIGNED: "is not signed, and ignored: load the key into it",
    wire.SIGNATURE: "is signed with another key, and ignored: load this key into it",
    wire.REPLAY: "repeats itself or has an old time, and is ignored: it needs a clock, or GPS",
    wire.AHEAD: "has a clock over a year ahead of ours, and is ignored: set the wrong one",
}


class Signing:
    """One key for a link. Nothing outlives it: frames up to a minute old could be played to the next one."""

    def __init__(self, key: SigningKey, link: int = 0, wall: Callable[[], float] = time.time) -> None:
        """link: our link id. wall: s since 1970."""
        self._key = key
        self._link = link
        self._wall = wall
        self._timestamps = Timestamps()
        self._told: set[tuple[str, str]] = set()
        self._problems: list[str] = []

    def hears(self, message: Any) -> bool:
        """Whether a decoded message is signed with our key and new."""
        reason = wire.refusal(bytes(message.get_msgbuf()), self._key, self._timestamps, self._clock())
        if reason and message.get_type() not in _RADIO:
            self._tell(reason, f"{message.get_srcSystem()}/{message.get_srcComponent()}")
        return not reason

    def sign(self, frame: bytes, message: Any) -> bytes:
        """`message`, packed as `frame`, with our signature."""
        stream = Stream(frame[5], frame[6], self._link)
        timestamp = self._timestamps.next(stream, self._clock())
        return self._key.sign(frame, message.crc_extra, self._link, timestamp)

    def problems(self) -> list[str]:
        """What was ignored and why, once of each sender."""
        problems, self._problems = self._problems, []
        return problems

    def _tell(self, reason: str, who: str) -> None:
        if (reason, who) not in self._told and len(self._told) < MAX_PROBLEMS:
            self._told.add((reason, who))
            self._problems.append(f"what {who} says {_WHY[reason]}")

    def _clock(self) -> int:
        return wire.ticks(self._wall())
