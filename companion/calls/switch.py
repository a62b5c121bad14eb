"""The off switch on the remote control: one channel, debounced. Pure: time is an input.

What is not known changes nothing: the position that was known last stands, on before any was.
"""

from __future__ import annotations

import math
from enum import Enum

AGREEING = 3
"""Frames in a row on one side before the switch counts as moved: one bad frame does nothing."""
GAP = 1.0
"""Seconds between two frames after which they are not in a row any more."""
SILENT = 3.0
"""Seconds without a pulse that makes sense until the switch counts as not heard."""
_HIGH, _LOW, _MIDDLE = 1700, 1300, 1500


class Side(str, Enum):
    """Which end of the channel is off."""

    HIGH = "high"
    """Above 1700 us is off, below 1500 us on; between them it is as it was."""
    LOW = "low"
    """Below 1300 us is off, above 1500 us on."""


class OffSwitch:
    """channel: 1 to 18. off: the position that counts. width: the newest pulse in us, None when unknown."""

    def __init__(self, channel: int, side: Side, now: float) -> None:
        self.channel = channel
        self.side = side
        self.off = False
        self.width: int | None = None
        self._heard_at = -math.inf
        self._since = now
        self._other = 0

    @property
    def name(self) -> str:
        """ "RC7"."""
        return f"RC{self.channel}"

    def hear(self, width: int | None, now: float) -> bool:
        """A pulse in us, None for one that is not known. True when the switch has moved."""
        self.width = width
        if width is None:
            self._other = 0
            return False
        in_a_row = now - self._heard_at <= GAP
        self._heard_at = now
        position = self._position(width)
        if position is None or position is self.off:
            self._other = 0
            return False
        self._other = self._other + 1 if in_a_row else 1
        if self._other < AGREEING:
            return False
        self.off, self._other = position, 0
        return True

    def heard(self, now: float) -> bool:
        """Whether the position is known; for the first seconds it is thought so."""
        return now - max(self._heard_at, self._since) <= SILENT

    def _position(self, width: int) -> bool | None:
        """Off, on, or None between the two."""
        if self.side is Side.HIGH:
            return True if width > _HIGH else False if width < _MIDDLE else None
        return True if width < _LOW else False if width > _MIDDLE else None
