"""What the frames say: reasons debounced, accepted ones left out, and how long nothing was OK."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from anytraverse.assessment import Assessment, Reason
from companion.calls.acceptance import Acceptance
from companion.calls.numbers import Numbers
from companion.calls.votes import Votes

CALLS_FOR_WORDS = frozenset({Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT})


class Sight:
    """Fails closed: no fresh frame is a fault, and no OK frame within T is a reason of its own.

    ok_run: OK frames in a row. bad_at: when a frame was last not OK.
    """

    def __init__(self, numbers: Numbers, now: float) -> None:
        self.numbers = numbers
        self.newest: Assessment | None = None
        self.acceptance: Acceptance | None = None
        self.ok_run = 0
        self.bad_at = now
        self._ok_at = self._seen_at = now
        self._votes = {reason: Votes(numbers.votes, numbers.window) for reason in Reason}
        self._open: frozenset[Reason] = frozenset()
        """The newest frame's reasons that nobody accepted."""

    def take(self, seen: Assessment, now: float, travelled: float | None) -> None:
        """A frame was judged. travelled: metres driven, None where not known."""
        self.newest, self._seen_at = seen, now
        self._open = seen.reasons - self._accepted(seen, now, travelled)
        waiting_for_match = seen.match is not None and seen.adopted is None
        for reason, votes in self._votes.items():
            bad = reason in self._open and not (waiting_for_match and reason is Reason.UNKNOWN_SCENE)
            clear = reason not in self._open and (reason in seen.reasons or seen.is_clear(reason))
            votes.add(bad=bad, clear=clear)
        if self._open or not seen.findings:
            self.bad_at, self.ok_run = now, 0
        else:
            self._ok_at, self.ok_run = now, self.ok_run + 1

    def reasons(self, now: float) -> frozenset[Reason]:
        """The reasons that count now."""
        active = {reason for reason, votes in self._votes.items() if votes.active}
        if not self.fresh(now):
            active.add(Reason.FAULT)
        if not active and now - self._ok_at > self.numbers.freshness:
            active |= self._open or {Reason.FAULT}
        return frozenset(active)

    def fresh(self, now: float) -> bool:
        """Whether a frame was judged within T."""
        return now - self._seen_at <= self.numbers.freshness

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
            scope = replace(scope, reasons=reasons, since=now, travelled=travelled)
        elif self.newest is not None:
            scope = Acceptance.of(self.newest, reasons, self.numbers, now, travelled)
        self.acceptance = scope
        for reason in reasons:
            self._votes[reason].reset()

    def _accepted(self, seen: Assessment, now: float, travelled: float | None) -> frozenset[Reason]:
        if self.acceptance is None:
            return frozenset()
        covered = self.acceptance.covers(seen, self.numbers)
        if Reason.UNKNOWN_OBJECT in covered:
            self.acceptance.follow(seen, self.numbers)
        if self.acceptance.ended(seen, self.numbers, now, travelled):
            self.acceptance = None
        return covered
