"""Follows by how much the vehicle drives faster than it was configured to. Pure: time is an input."""

from __future__ import annotations

import math

from companion.config.stopping import OVERSHOOT

RISES_AFTER, FALLS_AFTER = 1.0, 5.0
"""Seconds for which it must have driven faster, or slower, before that counts."""
_STEP = 0.25
"""m/s in which the speed is counted, so that a speed that is reported noisily changes nothing."""


class ExcessSpeed:
    """Follows the speed driven. speed: what counts, m/s as commanded; None: no more than configured.

    It rises to what was driven at least for `RISES_AFTER`, and falls to what was driven at most for
    `FALLS_AFTER`. A speed that is not known counts as none.
    """

    def __init__(self, configured: float | None) -> None:
        """configured: m/s, None: not configured. Then nothing is in excess."""
        self._configured = math.inf if configured is None else configured
        self._excess = self._pending = self._direction = 0
        """In steps of `_STEP`: what counts, and what follows it; whether that is more (1) or less (-1)."""
        self._since = 0.0

    @property
    def speed(self) -> float | None:
        """What counts, m/s as commanded; None where it is no more than configured."""
        return self._configured + _STEP * self._excess if self._excess else None

    def follow(self, driven: float | None, now: float) -> None:
        """Take in the speed over ground, m/s; None: not known."""
        over = (driven or 0.0) / OVERSHOOT - self._configured
        excess = round(over / _STEP) if over > 0.0 else 0
        direction = (excess > self._excess) - (excess < self._excess)
        if direction != self._direction:
            self._direction, self._since, self._pending = direction, now, excess
        elif direction:
            self._pending = (min if direction > 0 else max)(self._pending, excess)
        if direction and now - self._since >= (RISES_AFTER if direction > 0 else FALLS_AFTER):
            self._excess, self._direction = self._pending, 0
