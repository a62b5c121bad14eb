"""Finds the text that tells a person what an answer led to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anytraverse.assessment import Assessment, Reason
from anytraverse.memory import Memory
from companion.calls.decisions import Call, CallClosed, Decision, GoLapsed
from companion.calls.machine import OperatorCalls
from companion.calls.summary import blocked_text, still_open_text
from companion.wire import texts
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Kind, Result, Stage


def unremembered(acknowledgement: Acknowledgement) -> Acknowledgement:
    """Return the acknowledgement to send where the journal could not be written.

    An answer that was applied is acknowledged as applied and not remembered: a restart forgets it.
    """
    if acknowledgement.result not in (Result.APPLIED, Result.NOT_COVERED):
        return acknowledgement
    text = texts.unremembered(acknowledgement.text)
    return replace(acknowledgement, result=Result.APPLIED_NOT_REMEMBERED, text=text)


def outcome_text(
    calls: OperatorCalls,
    target: int,
    result: Result,
    decisions: Sequence[Decision],
    call_frame: Assessment | None,
    newest: Assessment | None,
    memory: Memory | None,
) -> str:
    """Return the text that tells a person what the applied answer led to.

    memory: after the answer's words, None where it had none.
    """
    if not target:
        return f"in use: {memory.preferences.format()}" if memory is not None else "nothing changed"
    if result is Result.STALE:
        # The id closed before its answer was applied. Its words are in use.
        in_use = "" if memory is None else f"{target} is closed; in use: {memory.preferences.format()}"
        return in_use or texts.stale(target)
    call = calls.call if calls.current_id == target else None
    closed = closed_call(decisions, target)
    if result is Result.NOT_COVERED and call_frame is not None:
        reasons = call_frame.reasons if call_frame.roi is not None else {Reason.UNKNOWN_OBJECT}
        return still_open_text(target, call_frame, reasons)
    if closed is not None:
        return texts.closed(Kind.CALL, target, closed.outcome)
    kind = calls.kind
    if newest is not None and Reason.BLOCKED in newest.reasons:
        return blocked_text(newest, target, kind)
    if calls.go_at is not None:
        return texts.waiting_for_view(kind, target)
    if any(isinstance(decision, GoLapsed) for decision in decisions):
        return texts.fit(f"{texts.name(kind, target)} no go: disarmed, or no autopilot")
    if calls.stage() is Stage.CLEAR:
        return texts.clear(kind, target)
    if call is not None and call.answered:
        return texts.answered_waiting(kind, target)
    return texts.fit(f"{texts.name(kind, target)} noted: still {'open' if call else 'holding'}")


def refused_match_text(text: str, *, forgotten: bool) -> str:
    """Return `text` with what a refused match led to. forgotten: a scene was refused too often to be kept."""
    return f"not that place{', a scene is forgotten' if forgotten else ''}; {text}"


def stale_text(calls: OperatorCalls, target: int) -> str:
    """Return the text for an answer to `target` that is not open, or to 0 where nothing may be meant."""
    if target == 0 and calls.current_id:
        return texts.just_announced(calls.kind, calls.current_id)
    return texts.stale(target)


def closed_call(decisions: Sequence[Decision], target: int) -> Call | None:
    """Return the call of this id that the decisions close, if any."""
    closed = (one.call for one in decisions if isinstance(one, CallClosed) and one.call.id == target)
    return next(closed, None)
