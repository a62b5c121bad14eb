"""Which policy is in force: the one asked for, unless the off switch on the remote control says off. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import Any

from companion.wire.ids import Policy

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


class PolicyState:
    """Two switches in a row: both must be on for anything to be done or told.

    asked: by the configuration, later by command. by: who asked, "" for the configuration.
    """

    def __init__(self, configured: Policy, switch: OffSwitch | None = None) -> None:
        self.asked = configured
        self.by = ""
        self.switch = switch

    @property
    def switched_off(self) -> bool:
        """Whether the remote control says off: then no command switches on."""
        return self.switch is not None and self.switch.off

    @property
    def in_force(self) -> Policy:
        """What counts."""
        return Policy.OFF if self.switched_off else self.asked

    @property
    def off_by(self) -> str:
        """Who keeps it off: "RC7" or "255/190", "" when it is on."""
        if self.switch is not None and self.switch.off:
            return self.switch.name
        return self.by if self.asked is Policy.OFF else ""

    def ask(self, policy: Policy, by: str) -> bool:
        """A command's policy. False where the remote control says off, and stays the stronger."""
        if self.switched_off and policy is not Policy.OFF:
            return False
        self.asked, self.by = policy, by
        return True

    def give_up_hold(self) -> bool:
        """The vehicle may not be held: it reports. True where it was to be held."""
        wanted = self.asked is Policy.HOLD
        if wanted:
            self.asked = Policy.REPORT
        return wanted

    def saved(self) -> dict[str, Any]:
        """What a restart must not turn on: who switched it off. JSON values."""
        return {
            "off_by": self.by if self.asked is Policy.OFF else None,
            "channel": self.switch.channel if self.switch is not None and self.switch.off else None,
        }

    def restore(self, saved: Any) -> None:
        """Off stays off over a restart; any other policy is the configuration's. Nonsense counts not."""
        if not isinstance(saved, Mapping):
            return
        off_by = saved.get("off_by")
        if isinstance(off_by, str) and off_by:
            self.asked, self.by = Policy.OFF, off_by
        if self.switch is not None:
            self.switch.off = saved.get("channel") == self.switch.channel
