"""Gives the wall-clock time: the computer's, or the autopilot's where the computer's was never set."""

from __future__ import annotations

import time
from collections.abc import Callable

SOFTWARE_MADE = 1_767_225_600.0
"""2026-01-01, in seconds since 1970. A clock that shows an earlier time was never set."""
_LATEST = 4_102_444_800.0
"""2100-01-01, in seconds since 1970."""


def is_set(seconds: float) -> bool:
    """Whether a time, in seconds since 1970, lies between 2026 and 2100. A clock outside was never set."""
    return SOFTWARE_MADE <= seconds < _LATEST


class WallClock:
    """Falls back to the autopilot's time (from GNSS) on a board whose clock has no battery."""

    def __init__(self, autopilot: Callable[[], float | None], wall: Callable[[], float] = time.time) -> None:
        """Both return seconds since 1970; `autopilot` returns None where the autopilot has no time."""
        self._autopilot_time = autopilot
        self._wall = wall

    def known(self) -> float | None:
        """Return the time in seconds since 1970, None where neither clock was set."""
        own = self._wall()
        return own if is_set(own) else self._autopilot_time()

    def stamp(self) -> float:
        """Return `known()`, or the computer's time where that is None: for records that need some time."""
        return self.known() or self._wall()
