"""Decides when a call opens and when it closes."""

from __future__ import annotations

from collections.abc import Callable

from anytraverse.assessment import Assessment, Reason
from companion.calls.decisions import Call, CallClosed, CallOpened, Decision
from companion.calls.hold_rules import HoldController
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import CALLS_FOR_WORDS, ReasonFilter
from companion.wire.ids import Outcome


class CallController:
    """Controls the one call. take_id: takes the next id of the counter that calls and holds share."""

    def __init__(
        self,
        numbers: Numbers,
        reason_filter: ReasonFilter,
        holding: HoldController,
        take_id: Callable[[], int],
    ) -> None:
        self._numbers = numbers
        self._reason_filter = reason_filter
        self._holding = holding
        self._take_id = take_id
        self.call: Call | None = None

    def restore(self, call: Call | None) -> None:
        """Take the call from before a restart."""
        self.call = call

    def add_frame(self, seen: Assessment) -> None:
        """Record a further frame in the open call, and track its thing."""
        if self.call is not None:
            self.call.add(seen)
            if self.call.thing is not None:
                self._reason_filter.things.watch(self.call.thing, seen)

    def settle(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        """Advance the call, and return the decisions."""
        decisions: list[Decision] = []
        asking, newest = reasons & CALLS_FOR_WORDS, self._reason_filter.newest
        holds = self._holding.hold is not None
        # With a hold, an answered call stays open until the go is fulfilled; new reasons need a new call.
        if self.call is not None and self.call.answered and (asking or not holds):
            decisions += self.close(self.call.outcome_now)
        if self.call is None and asking and newest is not None:
            decisions += self._open(asking, newest, now)
        call = self.call
        if call is None or call.answered:
            return decisions
        call.reasons |= asking
        if asking or Reason.FAULT in reasons or newest is None:
            call.gone_since = None
        elif call.gone_since is None:
            call.gone_since = now
        elif not holds and now - call.gone_since >= self._numbers.passed_after:
            decisions += self.close(Outcome.PASSED)
        return decisions

    def close(self, outcome: Outcome) -> list[Decision]:
        """Close the call, if one is open."""
        call, self.call = self.call, None
        if call is None:
            return []
        call.outcome = outcome
        return [CallClosed(call)]

    def _open(self, reasons: frozenset[Reason], seen: Assessment, now: float) -> list[Decision]:
        thing, seen = self._reason_filter.things.asked(seen, reasons)
        thing.call = self._take_id()
        self.call = Call(thing.call, seen.frame.id, set(reasons), now, seen, thing)
        self.call.add(seen)
        return [CallOpened(self.call), *self._holding.rename(self.call.id)]
