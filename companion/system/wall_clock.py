"""What time it is: the computer's own clock, unless nobody has ever set it."""

from __future__ import annotations

import time
from collections.abc import Callable

SOFTWARE_MADE = 1_767_225_600.0
"""2026-01-01 as seconds since 1970: a clock before it has never been set."""
_CENTURY_OVER = 4_102_444_800.0


def is_set(seconds: float) -> bool:
    """Whether a clock may show this, seconds since 1970: not before the software was made, nor after 2100."""
    return SOFTWARE_MADE <= seconds < _CENTURY_OVER


class WallClock:
    """A board without a battery starts anywhere in the past; then the autopilot's time counts, if any."""

    def __init__(self, told: Callable[[], float | None], wall: Callable[[], float] = time.time) -> None:
        """told: the autopilot's time now, seconds since 1970. wall: the computer's."""
        self._told = told
        self._wall = wall

    def known(self) -> float | None:
        """Seconds since 1970; None where nobody knows it."""
        own = self._wall()
        return own if is_set(own) else self._told()

    def stamp(self) -> float:
        """The same for what must have a time: at worst the computer's."""
        return self.known() or self._wall()
