"""Decides when a call opens and when it closes, and what an answer does to call and hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Reason
from anytraverse.operations import Operation, taps_of, weights_of
from anytraverse.preferences import clean_word
from anytraverse.regions import Box
from companion.calls.answered_things import MOST
from companion.calls.decisions import Call, CallClosed, CallOpened, CallState, Decision
from companion.calls.hold_rules import HoldController
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import CALLS_FOR_WORDS, PASSABLE, ReasonFilter
from companion.calls.thing import REASONS_OF_THINGS, scene_of
from companion.calls.tracking import blocked_by_name
from companion.wire.ids import Motion, Outcome, Result


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


def answer_call(
    call: Call,
    reason_filter: ReasonFilter,
    motion: Motion,
    operations: Sequence[Operation],
    outcome: AnswerOutcome | None,
    now: float,
    travelled: float | None,
    *,
    clear: bool = False,
) -> Result:
    """Apply an answer to `call`, and return the result to acknowledge.

    A go without words, or with words above 0, accepts the call's reasons; a later answer revokes that. One
    without words does not accept a thing that the vehicle drives round. Of a thing in a new place only a tap
    above 0 says that, since words may name the place. A word of 0 or below that names the thing makes it
    block. After any other answer the call's frame, judged again, decides whether the call is answered.
    outcome: the frames judged again. travelled: metres driven, or None.
    clear: the reasons are gone, and "clear now, go?" is asked. Then a go with any words answers the call,
    even if they do not cover the thing that is gone. Words of 0 or below accept nothing: it may come back.
    """
    things, changed = reason_filter.things, bool(operations)
    call.quiet = call.quiet or motion is Motion.STAY
    call.learnt = call.learnt or (outcome is not None and outcome.remembered)
    judged = outcome is not None and outcome.call is not None
    if outcome is not None and outcome.call is not None:
        call.seen = things.pointed(outcome.call)
    word = _forbidding(call, operations, judged=judged)
    if word and call.thing is not None:
        things.name(call.thing, word, now, travelled)
    covered = (judged or bool(word)) and not _uncovered_reasons(call, blocked=things.blocking(call.id))
    accepts = not changed or _drivable(call, operations)
    if motion is Motion.GO and (accepts or clear):
        if not call.answered:
            call.state = CallState.ANSWERED if changed and covered else CallState.ACCEPTED
        # A bare go before what is driven round means that, and not over it.
        round_it = not changed and reason_filter.goes_round(now)
        reasons = call.reasons - PASSABLE if round_it else call.reasons
        if accepts and reasons and call.thing is not None and not things.blocking(call.id):
            reason_filter.accept(call.thing, reasons, now, travelled)
        reason_filter.restart_after_answer(now)
        return Result.APPLIED
    things.revoke(call.id)
    if call.state is CallState.ACCEPTED:
        call.state = CallState.OPEN
    if not (judged or word):
        return Result.NOT_COVERED if changed else Result.APPLIED
    if covered and not call.answered:
        reason_filter.restart_after_answer(now)
    if covered:
        call.state = CallState.ANSWERED
    else:
        call.state = CallState.NOT_COVERED if changed else CallState.OPEN
    return Result.NOT_COVERED if call.state is CallState.NOT_COVERED else Result.APPLIED


def _drivable(call: Call, operations: Sequence[Operation]) -> bool:
    """Whether this answer says of the call's thing that it is drivable: words above 0, and nothing else.

    In a new place words may name the place and not the thing in it, so there the thing must be tapped.
    """
    taps = taps_of(operations)
    weights = [*weights_of(operations).values(), *(tap.weight for tap in taps)]
    if not weights or min(weights) <= 0.0:
        return False
    if call.reasons == {Reason.UNKNOWN_OBJECT} or Reason.UNKNOWN_OBJECT not in call.reasons:
        return True
    return call.thing is not None and any(call.thing.is_meant(Box(*tap.box), asked=True) for tap in taps)


def _forbidding(call: Call, operations: Sequence[Operation], *, judged: bool) -> str:
    """Return the word of this answer that says of the call's thing that it is not drivable, "" without one.

    It was tapped so, or the call's frame, judged again, finds the word in some of it.
    """
    thing, seen = call.thing, call.seen
    if thing is None or Reason.UNKNOWN_OBJECT not in call.reasons:
        return ""
    for tap in taps_of(operations):
        if tap.weight <= 0.0 and thing.overlap(Box(*tap.box), asked=True) > 0.0:
            return clean_word(tap.word)
    named = seen.roi.named_tile if judged and seen is not None and seen.roi is not None else None
    if seen is None or named is None or Reason.BLOCKED not in seen.reasons:
        return ""
    word = list(seen.words)[named.word]
    forbidden = {clean_word(name) for name, weight in weights_of(operations).items() if weight <= 0.0}
    return word if word in forbidden and thing.overlap(named.tile.box, asked=True) > 0.0 else ""


def _uncovered_reasons(call: Call, *, blocked: bool) -> frozenset[Reason]:
    """Return the call's reasons that its frame, judged again, still has.

    A frame that was not judged keeps all of them. An unknown scene is covered once the scene is in H, and a
    thing once it blocks by its name, `blocked`, even if the word finds only a part of it.
    """
    seen = call.seen
    if seen is None or seen.roi is None or Reason.FAULT in seen.reasons:
        return frozenset(call.reasons)
    learnt = {Reason.UNKNOWN_SCENE} if call.learnt else set[Reason]()
    return (seen.reasons & call.reasons) - learnt - ({Reason.UNKNOWN_OBJECT} if blocked else set())


def accept_taken_over(
    call: Call | None, reason_filter: ReasonFilter, now: float, travelled: float | None
) -> None:
    """Accept all that is in the way when a human takes over, who has seen it. For faults: `Faults.accept`."""
    things, newest = reason_filter.things, reason_filter.newest
    unanswered = frozenset(call.reasons) if call is not None and not call.answered else frozenset[Reason]()
    reasons = (reason_filter.reasons(now) | unanswered) - {Reason.FAULT}
    if Reason.BLOCKED in reasons and newest is not None and blocked_by_name(newest):
        # In the next frame the same thing may lose its name, and count as unknown.
        reasons |= {Reason.UNKNOWN_OBJECT}
    for thing in things.things:
        if thing.blocked_by:
            reason_filter.accept(thing, REASONS_OF_THINGS, now, travelled)
    if unanswered and call is not None and call.thing is not None:
        scene = scene_of(newest) if newest is not None else None
        reason_filter.accept(replace(call.thing, scene=scene), unanswered, now, travelled)
    for _ in range(MOST):
        if newest is None:
            break
        if reasons <= things.accepted and newest.reasons & reasons <= things.cover(newest).covered:
            break
        reason_filter.accept(things.asked(newest, reasons)[0], reasons, now, travelled)
    reason_filter.restart_after_answer(now)
