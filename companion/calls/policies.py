"""Which policy is in force: the one asked for, unless the off switch on the remote control says off. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from companion.calls.switch import OffSwitch
from companion.wire.ids import Policy


class Policies:
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
