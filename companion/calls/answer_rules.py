"""Applies an operator's answer, or a human's take-over, to the open call."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Reason
from companion.calls.acceptance import Acceptance, blocked_by_name, scene_of
from companion.calls.decisions import Call, CallState
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
    """Apply an answer to `call`, and return the result to acknowledge.

    A go without words accepts the call's reasons; a later answer revokes that. After any other answer the
    call's frame, judged again, decides whether the call is answered.
    changed: the answer teaches words. outcome: the frames judged again. travelled: metres driven, or None.
    clear: the reasons are gone, and "clear now, go?" is asked. Then a go with words answers the call, too,
    even if the words do not cover the thing that is gone. But it accepts nothing: the thing may come back,
    and the words may say that it is not drivable.
    """
    call.quiet = call.quiet or motion is Motion.STAY
    call.learnt = call.learnt or (outcome is not None and outcome.remembered)
    if motion is Motion.GO and (not changed or clear):
        if outcome is not None and outcome.call is not None:
            call.seen = outcome.call
        if not call.answered:
            call.state = CallState.ACCEPTED
            if not changed:
                reason_filter.accept(
                    call.reasons, _scope(call, reason_filter, now, travelled), now, travelled
                )
            reason_filter.restart_after_answer(now)
        return Result.APPLIED
    if call.state is CallState.ACCEPTED:
        call.state = CallState.OPEN
        reason_filter.revoke_acceptance()
    if outcome is None or outcome.call is None:
        return Result.NOT_COVERED if changed else Result.APPLIED
    call.seen = outcome.call
    covered = not _uncovered_reasons(call)
    if covered and not call.answered:
        reason_filter.restart_after_answer(now)
    if covered:
        call.state = CallState.ANSWERED
    else:
        call.state = CallState.NOT_COVERED if changed else CallState.OPEN
    return Result.NOT_COVERED if call.state is CallState.NOT_COVERED else Result.APPLIED


def _uncovered_reasons(call: Call) -> frozenset[Reason]:
    """Return the call's reasons that its frame, judged again, still has.

    A frame that was not judged keeps all of them. An unknown scene is covered once the scene is in H.
    """
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
    """Accept what is in the way when a human takes over, who has seen it. For faults see `Faults.accept`."""
    newest = reason_filter.newest
    unanswered = call.reasons if call is not None and not call.answered else set[Reason]()
    reasons = (reason_filter.reasons(now) | unanswered) - {Reason.FAULT}
    if Reason.BLOCKED in reasons and newest is not None and blocked_by_name(newest):
        # In the next frame the same thing may lose its name, and count as unknown.
        reasons |= {Reason.UNKNOWN_OBJECT}
    scope = call.scope if call is not None else None
    if scope is not None and scope.thing is None and Reason.UNKNOWN_OBJECT in reasons:
        # The call was for a scene alone. Without a thing it would cover no object: accept what is seen now.
        scope = None
    if scope is not None and newest is not None:
        scope = replace(scope, scene=scene_of(newest))
        if Reason.BLOCKED in reasons:
            # What blocks the way may be another thing than the call's: accept it as it is now.
            blocked = Acceptance.of(
                newest, frozenset({Reason.BLOCKED}), reason_filter.numbers, now, travelled
            )
            scope = scope.joined(blocked)
    reason_filter.accept(reasons, scope, now, travelled)
    reason_filter.restart_after_answer(now)
