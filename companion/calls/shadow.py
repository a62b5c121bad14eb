"""What the hold policy would have held, had it been in force. Pure: time is an input."""

from __future__ import annotations

import math
from dataclasses import dataclass

from anytraverse.assessment import Reason
from companion.calls.decisions import Decision, WouldHold, WouldResume

_LONGEST_STEP = 2.0
"""Seconds between two looks that still count as watched: beyond it the daemon itself was stopped."""


@dataclass
class Shadow:
    """One would-be hold at a time, as there is one hold at a time.

    It begins when the hold policy would have held, and ends with as many OK frames in a row as a resume
    needs, or with a human who takes over.

    count: would-be holds so far. watched: seconds in which one could have begun or stood.
    open: reasons of the one that stands now, empty without one.
    """

    count: int = 0
    watched: float = 0.0
    open: frozenset[Reason] = frozenset()
    began_at: float = 0.0
    _looked_at: float = math.inf

    def look(
        self, reasons: frozenset[Reason], now: float, *, watching: bool, taken: bool, clear: bool
    ) -> list[Decision]:
        """What is decided now.

        watching: a hold could begin. taken: a human drives. clear: N frames in a row were OK.
        """
        if watching and 0 < now - self._looked_at <= _LONGEST_STEP:
            self.watched += now - self._looked_at
        self._looked_at = now if watching else math.inf
        if self.open:
            over = taken or (not reasons and clear)
            return [*self._end(now, by_hand=taken)] if over else []
        if not reasons or not watching:
            return []
        self.count += 1
        self.open, self.began_at = reasons, now
        return [WouldHold(reasons, self.count)]

    def begin_anew(self) -> None:
        """Forget what was counted; what would be held now is counted as the first."""
        self.count, self.watched, self.open = 0, 0.0, frozenset()

    def leave(self, now: float) -> list[WouldResume]:
        """Another policy: nothing is watched any more."""
        self._looked_at = math.inf
        return self._end(now, by_hand=True) if self.open else []

    def _end(self, now: float, *, by_hand: bool) -> list[WouldResume]:
        over = WouldResume(self.open, self.count, now - self.began_at, by_hand)
        self.open = frozenset()
        return [over]
