"""What time it is for signatures: the computer's, unless that is plainly wrong."""

from __future__ import annotations

import time
from collections.abc import Callable

from companion.wall_clock import SOFTWARE_MADE
from companion.wire.signing import MINUTE, TICKS, ticks

DAY = 24 * 60 * MINUTE


class SigningClock:
    """A board without a battery starts anywhere in the past; then only verified frames tell the time.

    heard: the newest timestamp before the restart. wall: s since 1970.
    """

    def __init__(self, heard: int, wall: Callable[[], float] = time.time) -> None:
        self._least = max(ticks(SOFTWARE_MADE), heard - DAY)
        self._wall = wall
        self._told: int | None = None

    def now(self, now: float) -> int | None:
        """The time as a timestamp; None where nobody knows it. now: s, monotonic."""
        own = ticks(self._wall())
        if own >= self._least:
            return own
        return None if self._told is None else self._told + int(now * TICKS)

    def tell(self, timestamp: int, now: float) -> None:
        """A verified source says that it is `timestamp`, or was a moment ago."""
        if timestamp >= self._least:
            told = timestamp - int(now * TICKS)
            self._told = told if self._told is None else max(self._told, told)
