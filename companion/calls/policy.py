"""Decides which policy is in force: the requested one, unless the off switch on the RC says off. Pure.

Counts what the hold policy would have held, for the shadow policy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from anytraverse.assessment import Reason
from companion.calls.decisions import Decision, WouldHold, WouldResume
from companion.wire.ids import Policy

AGREEING = 3
"""RC frames in a row on the other side before the switch counts as moved: one bad frame changes nothing."""
GAP = 1.0
"""Seconds. RC frames that are further apart do not count as in a row."""
SILENT = 3.0
"""Seconds without a valid pulse after which the switch counts as lost."""
_HIGH, _LOW, _MIDDLE = 1700, 1300, 1500
_LONGEST_STEP = 2.0
"""Seconds. A longer time between two updates is not counted as watched: the daemon itself stood still."""


class Side(str, Enum):
    """The end of the channel that means off."""

    HIGH = "high"
    """Above 1700 us is off, below 1500 us is on; between them the position stays."""
    LOW = "low"
    """Below 1300 us is off, above 1500 us is on; between them the position stays."""


class OffSwitch:
    """Debounces an RC channel that switches the companion off.

    channel: 1 to 18. off: the debounced position. width: the newest pulse in us, None when unknown.
    lost: no valid pulses came for a while, as of the last `check`.
    """

    def __init__(self, channel: int, side: Side, now: float) -> None:
        self.channel = channel
        self.side = side
        self.off = False
        self.width: int | None = None
        self.lost = False
        self._pulse_at = -math.inf
        self._created_at = now
        self._opposite = 0

    @property
    def name(self) -> str:
        """The channel's name, e.g. "RC7"."""
        return f"RC{self.channel}"

    def pulse_received(self, width: int | None, now: float) -> bool:
        """Take in a pulse in us, None where it is unknown. Returns whether the switch has moved.

        An unknown pulse leaves the position as it was.
        """
        self.width = width
        if width is None:
            self._opposite = 0
            return False
        in_a_row = now - self._pulse_at <= GAP
        self._pulse_at = now
        position = self._position(width)
        if position is None or position is self.off:
            self._opposite = 0
            return False
        self._opposite = self._opposite + 1 if in_a_row else 1
        if self._opposite < AGREEING:
            return False
        self.off, self._opposite = position, 0
        return True

    def check(self, now: float) -> bool:
        """Update `lost`. Returns whether it changed. In the first seconds no pulse can have come yet."""
        before, self.lost = self.lost, now - max(self._pulse_at, self._created_at) > SILENT
        return self.lost is not before

    def _position(self, width: int) -> bool | None:
        """Return True for off, False for on, None between the two."""
        if self.side is Side.HIGH:
            return True if width > _HIGH else False if width < _MIDDLE else None
        return True if width < _LOW else False if width > _MIDDLE else None


class PolicyState:
    """The only place that knows the policy: the requested one, the off switch, and the one in force.

    Off wins, whichever of the two says it. Who changes anything here passes the policy that was in force
    before to `OperatorCalls.policy_changed` at once.

    requested: the policy requested by the configuration, a parameter or a command. requested_by: the sender
    that requested it, "" for the configuration. Only a person's request lowers it: hold that cannot be given
    is a fault (`Fault.POLICY`), and stays in force.
    """

    def __init__(self, configured: Policy, switch: OffSwitch | None = None) -> None:
        self.requested = configured
        self.requested_by = ""
        self.switch = switch

    @property
    def switched_off(self) -> bool:
        """Whether the RC switch says off. Then no request can switch on."""
        return self.switch is not None and self.switch.off

    @property
    def in_force(self) -> Policy:
        """The policy in force."""
        return Policy.OFF if self.switched_off else self.requested

    @property
    def off_by(self) -> str:
        """Who keeps the companion off: "RC7", or a sender's ids as "255/190"; "" when it is on."""
        if self.switch is not None and self.switch.off:
            return self.switch.name
        return self.requested_by if self.requested is Policy.OFF else ""

    def request(self, policy: Policy, by: str) -> bool:
        """Request a policy for the sender `by`. False: it is refused, since the off switch says off."""
        if self.switched_off and policy is not Policy.OFF:
            return False
        self.requested, self.requested_by = policy, by
        return True

    def saved(self) -> dict[str, Any]:
        """Return who switched it off, as JSON values for the journal: a restart must not switch on."""
        return {
            "off_by": self.requested_by if self.requested is Policy.OFF else None,
            "channel": self.switch.channel if self.switch is not None and self.switch.off else None,
        }

    def restore(self, saved: Any) -> None:
        """Restore off from what `saved` returned. Any other policy is the configuration's.

        Invalid values are ignored.
        """
        if not isinstance(saved, Mapping):
            return
        off_by = saved.get("off_by")
        if isinstance(off_by, str) and off_by:
            self.requested, self.requested_by = Policy.OFF, off_by
        if self.switch is not None:
            self.switch.off = saved.get("channel") == self.switch.channel


@dataclass
class Shadow:
    """Tracks would-be holds: at most one at a time, as there is at most one hold.

    One begins when the hold policy would have held. It ends after as many OK frames in a row as a resume
    needs, or when a human takes over.

    count: would-be holds so far. watched: seconds in which one could have begun or lasted.
    open: reasons of the current one, empty without one. began_at: monotonic seconds.
    """

    count: int = 0
    watched: float = 0.0
    open: frozenset[Reason] = frozenset()
    began_at: float = 0.0
    _updated_at: float = math.inf

    def update(
        self, reasons: frozenset[Reason], now: float, *, watching: bool, taken: bool, clear: bool
    ) -> list[Decision]:
        """Update the current would-be hold, and return the decisions.

        watching: a hold could begin. taken: a human drives. clear: N frames in a row were OK.
        """
        if watching and 0 < now - self._updated_at <= _LONGEST_STEP:
            self.watched += now - self._updated_at
        self._updated_at = now if watching else math.inf
        if self.open:
            over = taken or (not reasons and clear)
            return [*self._end(now, by_hand=taken)] if over else []
        if not reasons or not watching:
            return []
        self.count += 1
        self.open, self.began_at = reasons, now
        return [WouldHold(reasons, self.count)]

    def reset(self) -> None:
        """Reset the counts. A would-be hold that lasts now is counted again, as the first."""
        self.count, self.watched, self.open = 0, 0.0, frozenset()

    def stop(self, now: float) -> list[WouldResume]:
        """Stop watching, since another policy is in force. The current would-be hold ends."""
        self._updated_at = math.inf
        return self._end(now, by_hand=True) if self.open else []

    def _end(self, now: float, *, by_hand: bool) -> list[WouldResume]:
        over = WouldResume(self.open, self.count, now - self.began_at, by_hand)
        self.open = frozenset()
        return [over]
