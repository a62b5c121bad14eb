"""Counts what the hold policy would have held, for the shadow policy. Pure: time is an input."""

from __future__ import annotations

import math
from dataclasses import dataclass

from anytraverse.assessment import Reason
from companion.calls.decisions import Decision, WouldHold, WouldResume

_LONGEST_STEP = 2.0
"""Seconds. A longer time between two updates is not counted as watched: the daemon itself stood still."""


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
