"""Follows by how much the vehicle drives faster than it was configured to. Pure: time is an input."""

from __future__ import annotations

import math

from companion.config.stopping import OVERSHOOT
from companion.vehicle.course import STALE

RISES_AFTER, FALLS_AFTER = 1.0, 5.0
"""Seconds for which reports must say that it drives faster, or slower, before that counts."""
_STEP = 0.25
"""m/s in which the speed is counted, so that a speed that is reported noisily changes nothing."""


class ExcessSpeed:
    """Follows the reports of the speed. speed: what counts, m/s as commanded; None: no more than configured.

    It rises to what was driven at least for `RISES_AFTER`, and falls to what was driven at most for
    `FALLS_AFTER`. While no report comes it stays as it is, and what is rising or falling begins anew.
    """

    def __init__(self, configured: float | None) -> None:
        """configured: m/s, None: not configured. Then nothing is in excess."""
        self._configured = math.inf if configured is None else configured
        self._excess = self._pending = self._direction = 0
        """In steps of `_STEP`: what counts, and what follows it; whether that is more (1) or less (-1)."""
        self._since = self._newest = -math.inf

    @property
    def speed(self) -> float | None:
        """What counts, m/s as commanded; None where it is no more than configured."""
        return self._configured + _STEP * self._excess if self._excess else None

    def reported(self, driven: float, at: float) -> None:
        """Take in a report of the speed over ground, m/s. at: when it came.

        The same report may be given again.
        """
        if at == self._newest:
            return
        gap, self._newest = at - self._newest, at
        over = driven / OVERSHOOT - self._configured
        excess = round(over / _STEP) if over > 0.0 else 0
        direction = (excess > self._excess) - (excess < self._excess)
        if direction != self._direction or not 0.0 <= gap <= STALE:
            self._direction, self._since, self._pending = direction, at, excess
        elif direction:
            self._pending = (min if direction > 0 else max)(self._pending, excess)
        if direction and at - self._since >= (RISES_AFTER if direction > 0 else FALLS_AFTER):
            self._excess, self._direction = self._pending, 0

    def forget(self) -> None:
        """Count nothing: a human drives."""
        self._excess = self._direction = 0
