"""The reasons of the frames, debounced; accepted ones are left out. Pure: time is an input."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from anytraverse.assessment import Assessment, Reason
from companion.calls.acceptance import Acceptance
from companion.calls.numbers import Numbers


class Debounce:
    """Active after `needed` bad frames of the last `window`; ends after as many clear ones."""

    def __init__(self, needed: int, window: int) -> None:
        self._needed = needed
        self._frames: deque[tuple[bool, bool]] = deque(maxlen=window)
        self.active = False

    def add(self, *, bad: bool, clear: bool) -> None:
        """One more frame; between bad and clear it votes for neither."""
        self._frames.append((bad, clear))
        if sum(bad for bad, _ in self._frames) >= self._needed:
            self.active = True
        elif sum(clear for _, clear in self._frames) >= self._needed:
            self.active = False

    def amend(self, *, bad: bool, clear: bool) -> None:
        """The newest frame votes anew, not twice."""
        if self._frames:
            self._frames.pop()
        self.add(bad=bad, clear=clear)

    def reset(self) -> None:
        """Inactive, with nothing remembered."""
        self._frames.clear()
        self.active = False


CALLS_FOR_WORDS = frozenset({Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT})
_OF_THINGS = frozenset({Reason.UNKNOWN_OBJECT, Reason.BLOCKED})


class ReasonFilter:
    """Fails closed: no fresh frame is a fault, and no OK frame within T is a reason of its own.

    A frame's age counts from its capture: one that waited anywhere for longer than T is not OK, and ends no
    reason.

    ok_run: OK frames in a row. bad_at: when it was last not OK, be it by a frame or by the lack of one.
    """

    def __init__(self, numbers: Numbers, now: float) -> None:
        self.numbers = numbers
        self.newest: Assessment | None = None
        self.acceptance: Acceptance | None = None
        self.ok_run = 0
        self.was_ok = False
        """Whether any frame was: before that nothing can be said to be OK, though no reason counts yet."""
        self.bad_at = now
        self._ok_at = self._seen_at = now
        """Capture of the newest frame that was OK, and of the newest of all."""
        self._ok = False
        self._votes = {reason: Debounce(numbers.votes, numbers.window) for reason in Reason}
        self._open: frozenset[Reason] = frozenset()
        """The newest frame's reasons that nobody accepted."""

    def take(self, seen: Assessment, now: float, travelled: float | None, *, settled: bool = True) -> None:
        """A new frame was judged. travelled: metres driven, None where not known. settled: it may add to
        `ok_run`."""
        self.pass_time(now)
        self._seen_at = max(self._seen_at, _captured(seen, now))
        self._weigh(seen, now)
        acceptance = self.acceptance
        if acceptance is not None:
            if (seen.reasons - self._open) & _OF_THINGS:
                acceptance.follow(seen, self.numbers)
            if acceptance.ended(seen, self.numbers, now, travelled):
                self.acceptance = None
        for reason, votes in self._votes.items():
            bad, clear = self._vote(reason, seen, now)
            votes.add(bad=bad, clear=clear)
        if self._ok:
            self.ok_run += settled

    def judge_again(self, seen: Assessment, now: float) -> None:
        """The newest frame was judged again: what it says counts instead of what it said, not in addition."""
        self._weigh(seen, now)
        for reason, votes in self._votes.items():
            bad, clear = self._vote(reason, seen, now)
            votes.amend(bad=bad, clear=clear)

    def pass_time(self, now: float) -> None:
        """Without frames nothing is OK."""
        if not self.fresh(now):
            self.bad_at, self.ok_run = now, 0

    def reasons(self, now: float) -> frozenset[Reason]:
        """The reasons that count now."""
        active = {reason for reason, votes in self._votes.items() if votes.active}
        if not self.fresh(now):
            active.add(Reason.FAULT)
        if not active and now - self._ok_at > self.numbers.freshness:
            active |= self._open or {Reason.FAULT}
        return frozenset(active)

    def fresh(self, now: float) -> bool:
        """Whether a frame that was captured within T has been judged."""
        return now - self._seen_at <= self.numbers.freshness

    def look_again(self) -> None:
        """Only what is seen from now on counts; a fault stays one until frames show otherwise."""
        for reason in Reason:
            if reason is not Reason.FAULT:
                self._votes[reason].reset()

    def look_afresh(self, now: float) -> None:
        """What was seen before an answer says nothing about what it changed: votes and T start anew."""
        for reason in CALLS_FOR_WORDS:
            self._votes[reason].reset()
        self._open = frozenset()
        self._ok_at = now

    def accept(
        self, reasons: Iterable[Reason], scope: Acceptance | None, now: float, travelled: float | None
    ) -> None:
        """Accept `reasons` within `scope`, or without one within what the newest frame shows."""
        reasons = frozenset(reasons)
        if not reasons:
            return
        if scope is not None:
            scope = replace(scope, reasons=reasons, since=now, travelled=travelled, clear_frames=0)
        elif self.newest is not None:
            scope = Acceptance.of(self.newest, reasons, self.numbers, now, travelled)
        self.acceptance = scope
        for reason in reasons:
            self._votes[reason].reset()

    def _weigh(self, seen: Assessment, now: float) -> None:
        covered = self.acceptance.covers(seen, self.numbers) if self.acceptance is not None else frozenset()
        self.newest, self._open = seen, seen.reasons - covered
        self._ok = bool(seen.findings) and not self._open and not self._is_old(seen, now)
        self.was_ok = self.was_ok or self._ok
        if self._ok:
            self._ok_at = max(self._ok_at, _captured(seen, now))
        else:
            self.bad_at, self.ok_run = now, 0

    def _is_old(self, seen: Assessment, now: float) -> bool:
        return now - seen.frame.captured_at > self.numbers.freshness

    def _vote(self, reason: Reason, seen: Assessment, now: float) -> tuple[bool, bool]:
        """Bad, clear or neither. A remembered scene that may still be adopted is not voted against."""
        if reason in self._open:
            waiting = reason is Reason.UNKNOWN_SCENE and seen.match is not None and seen.adopted is None
            return not waiting, False
        clear = reason in seen.reasons or seen.is_clear(reason)
        return False, clear and not self._is_old(seen, now)


def _captured(seen: Assessment, now: float) -> float:
    """One in the future is a fault of its frame, and makes nothing after it fresh."""
    return min(seen.frame.captured_at, now)
