"""What an answer, or a human who takes over, does to the open call."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Reason
from companion.calls.acceptance import Acceptance, blocked_by_name, scene_of
from companion.calls.decisions import Call
from companion.calls.reason_filter import ReasonFilter
from companion.wire.ids import Motion, Result


def answer_call(
    call: Call,
    reason_filter: ReasonFilter,
    motion: Motion,
    changed: bool,
    outcome: AnswerOutcome | None,
    now: float,
    travelled: float | None,
    *,
    clear: bool = False,
) -> Result:
    """A go without words accepts what the call is for; anything else takes such a go back.

    Otherwise the call's frame, judged again, decides whether it is answered. clear: "clear now, go?" is
    asked, so that a go is one with words, too: whether they cover a thing that is gone is not in its way. Nor
    is it accepted then: it may be back, and they may name it as a danger.
    """
    call.quiet = call.quiet or motion is Motion.STAY
    call.learnt = call.learnt or (outcome is not None and outcome.remembered)
    if motion is Motion.GO and (not changed or clear):
        if outcome is not None and outcome.call is not None:
            call.seen = outcome.call
        if not call.answered:
            call.answered = call.accepted = True
            if not changed:
                reason_filter.accept(
                    call.reasons, _scope(call, reason_filter, now, travelled), now, travelled
                )
            reason_filter.look_afresh(now)
        return Result.APPLIED
    if call.accepted:
        call.answered = call.accepted = False
        reason_filter.acceptance = None
    if outcome is None or outcome.call is None:
        return Result.NOT_COVERED if changed else Result.APPLIED
    call.seen = outcome.call
    covered = not _left(call)
    if covered and not call.answered:
        reason_filter.look_afresh(now)
    call.answered, call.tried = covered, changed and not covered
    return Result.NOT_COVERED if call.tried else Result.APPLIED


def _left(call: Call) -> frozenset[Reason]:
    """The call's reasons that its frame still has. What was not judged is not covered; a place in H is."""
    seen = call.seen
    if seen is None or seen.roi is None or Reason.FAULT in seen.reasons:
        return frozenset(call.reasons)
    return (seen.reasons & call.reasons) - ({Reason.UNKNOWN_SCENE} if call.learnt else set())


def _scope(call: Call, reason_filter: ReasonFilter, now: float, travelled: float | None) -> Acceptance | None:
    if call.scope is None and call.seen is not None:
        return Acceptance.of(call.seen, frozenset(call.reasons), reason_filter.numbers, now, travelled)
    return call.scope


def accept_taken_over(
    call: Call | None, reason_filter: ReasonFilter, now: float, travelled: float | None
) -> None:
    """Whoever drives on by hand has seen what is there, and where; a fault cannot be accepted."""
    newest = reason_filter.newest
    asked = call.reasons if call is not None and not call.answered else set[Reason]()
    reasons = (reason_filter.reasons(now) | asked) - {Reason.FAULT}
    if Reason.BLOCKED in reasons and newest is not None and blocked_by_name(newest):
        reasons |= {Reason.UNKNOWN_OBJECT}  # which it may be taken for in the next frame
    scope = call.scope if call is not None else None
    if scope is not None and scope.thing is None and Reason.UNKNOWN_OBJECT in reasons:
        scope = None
    if scope is not None and newest is not None:
        scope = replace(scope, scene=scene_of(newest))
        if Reason.BLOCKED in reasons:  # a thing of its own, which no call was for
            blocked = Acceptance.of(
                newest, frozenset({Reason.BLOCKED}), reason_filter.numbers, now, travelled
            )
            scope = scope.joined(blocked)
    reason_filter.accept(reasons, scope, now, travelled)
    reason_filter.look_afresh(now)
