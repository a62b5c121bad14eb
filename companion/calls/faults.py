"""Keeps the faults that stand, and what a human accepted of them by driving on. Pure: time is an input."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum

from companion.calls.numbers import Numbers

ACCEPTANCES = 3
WITHIN = 600.0
"""A fault is accepted by hand at most `ACCEPTANCES` times in this many seconds."""
TOLD_FOR = 1.0
"""Seconds for which a fault and its hold must have been told before a human's mode accepts the fault."""
FLICKERS = 2.0
"""Seconds for which a fault must be gone to be another one when it comes again."""
LAST_SECONDS, LAST_METRES = 5.0, 3.0
"""The end of an acceptance is told when no more than one of these is left."""


class Fault(str, Enum):
    """A cause of `Reason.FAULT`."""

    VIEW = "view"
    """No fresh frame was judged, or what was judged is not finite."""
    COURSE = "course"
    """The vehicle drives where the camera does not look."""
    POLICY = "policy"
    """The policy hold is in force, and cannot be given."""
    REGION = "region"
    """The vehicle does not fit into the region of interest."""


@dataclass
class FaultAcceptance:
    """What a human accepted by driving on over a hold, and for how long.

    faults: those that stood. since: monotonic seconds. travelled: metres driven then, None where not known.
    ending: that it ends soon was told.
    """

    faults: frozenset[Fault]
    since: float
    travelled: float | None
    ending: bool = False

    def left(self, numbers: Numbers, now: float, travelled: float | None) -> tuple[float, float | None]:
        """Return the seconds and metres that are left of it, metres None where the position is not known."""
        seconds = numbers.accepted_for - (now - self.since)
        if travelled is None or self.travelled is None:
            return seconds, None
        return seconds, numbers.accepted_distance - (travelled - self.travelled)


class Faults:
    """The faults that stand, and the acceptance in force.

    told: what to say of each standing fault, in two or three words; "" for `Fault.VIEW`, which others name.
    acceptance: None without one.
    """

    def __init__(self, numbers: Numbers) -> None:
        self._numbers = numbers
        self._since: dict[Fault, float] = {}
        self._ended: dict[Fault, tuple[float, float]] = {}
        """Of each fault that is gone: since when it stood, and until when."""
        self.told: dict[Fault, str] = {}
        self.acceptance: FaultAcceptance | None = None
        self._accepted_at: deque[float] = deque(maxlen=ACCEPTANCES)

    @property
    def standing(self) -> frozenset[Fault]:
        """The faults that stand, accepted or not."""
        return frozenset(self._since)

    @property
    def accepted(self) -> frozenset[Fault]:
        """The faults that do not count for now, since a human drives on in spite of them."""
        return self.acceptance.faults if self.acceptance is not None else frozenset()

    def report(self, fault: Fault, now: float, *, stands: bool, what: str = "") -> None:
        """Take in whether `fault` stands. what: its name for people, in two or three words."""
        if stands and fault not in self._since:
            since, until = self._ended.get(fault, (now, -math.inf))
            self._since[fault] = since if now - until <= FLICKERS else now
        elif not stands and fault in self._since:
            self._ended[fault] = self._since.pop(fault), now
        if stands:
            self.told[fault] = what
        else:
            self.told.pop(fault, None)

    def accept(self, now: float, travelled: float | None) -> FaultAcceptance | None:
        """Accept the faults that have been told for long enough.

        Returns None where there is none, or where faults were accepted too often of late.
        """
        told = frozenset(fault for fault, since in self._since.items() if now - since >= TOLD_FOR)
        if not told or self.refuses(now):
            return None
        self._accepted_at.append(now)
        self.acceptance = FaultAcceptance(told, now, travelled)
        return self.acceptance

    def refuses(self, now: float) -> bool:
        """Whether faults were accepted so often of late that no further one is."""
        return len(self._accepted_at) == ACCEPTANCES and now - self._accepted_at[0] < WITHIN

    def revoke(self) -> None:
        """End the acceptance."""
        self.acceptance = None

    def tick(self, now: float, travelled: float | None, *, sees: bool) -> FaultAcceptance | None:
        """End the acceptance where its time or distance is used up, or its faults are gone.

        sees: N frames in a row were OK. Returns the acceptance once, shortly before it ends.
        """
        acceptance = self.acceptance
        if acceptance is None:
            return None
        seconds, metres = acceptance.left(self._numbers, now, travelled)
        if sees:
            # A course is gone in each standstill, and back as the vehicle drives on: it stays accepted.
            acceptance.faults &= self.standing | {Fault.COURSE}
        if not acceptance.faults or seconds <= 0.0 or (metres is not None and metres <= 0.0):
            self.acceptance = None
            return None
        soon = seconds <= LAST_SECONDS or (metres is not None and metres <= LAST_METRES)
        if acceptance.ending or not soon or not acceptance.faults & self.standing:
            return None
        acceptance.ending = True
        return acceptance
