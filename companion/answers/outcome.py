"""Says what an answer led to: the figures of its acknowledgement, and a text for a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anytraverse.assessment import Assessment, Reason
from anytraverse.memory import Memory
from anytraverse.preferences import Preferences
from companion.answers.answer import Answer
from companion.calls.decisions import CallClosed, Decision, GoLapsed
from companion.calls.machine import OperatorCalls
from companion.telemetry.summary import blocked_text, flags
from companion.wire import texts
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Kind, Outcome, Result, Stage, words_hash

_UNREMEMBERED = "not remembered (disk?): "


def acknowledgement(
    answer: Answer,
    calls: OperatorCalls,
    words: Preferences,
    target: int,
    result: Result,
    text: str,
    *,
    decisions: Sequence[Decision] = (),
    call_frame: Assessment | None = None,
    newest: Assessment | None = None,
) -> Acknowledgement:
    """Make the acknowledgement of an answer, from what it was decided to lead to.

    target: the id that it was applied to, 0 for words alone. words: in use now. call_frame: the call's frame
    judged again. newest: the newest frame.
    """
    closed = _closed(decisions, target)
    roi, tile = (call_frame.roi, call_frame.tile) if call_frame is not None else (None, None)
    current = target and target == calls.current_id
    return Acknowledgement(
        transaction=answer.transaction,
        target=target,
        result=result,
        stage=calls.stage() if current else Stage.CLOSED,
        outcome=closed.call.outcome if closed else Outcome.NONE,
        roi_uncertainty=roi.uncertainty if roi else None,
        worst_tile=tile.uncertainty if tile else None,
        reasons=flags(newest.reasons) if newest is not None else flags(()),
        words=words_hash(words),
        text=text,
    )


def unremembered(acknowledgement: Acknowledgement) -> Acknowledgement:
    """Return the acknowledgement to send where the journal could not be written.

    An answer that was applied is acknowledged as applied and not remembered: a restart forgets it.
    """
    if acknowledgement.result not in (Result.APPLIED, Result.NOT_COVERED):
        return acknowledgement
    text = _UNREMEMBERED + acknowledgement.text
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
    closed = _closed(decisions, target)
    if result is Result.NOT_COVERED and call_frame is not None:
        if Reason.UNKNOWN_OBJECT in call_frame.reasons or call_frame.roi is None:
            return texts.still_unknown(target, call_frame.roi.uncertainty if call_frame.roi else None)
        return texts.still_new(target, call_frame.similarity)
    if closed is not None:
        return texts.closed(Kind.CALL, target, closed.call.outcome)
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


def stale_text(calls: OperatorCalls, target: int) -> str:
    """Return the text for an answer to `target` that is not open, or to 0 where nothing may be meant."""
    if target == 0 and calls.current_id:
        return texts.just_announced(calls.kind, calls.current_id)
    return texts.stale(target)


def _closed(decisions: Sequence[Decision], target: int) -> CallClosed | None:
    return next((one for one in decisions if isinstance(one, CallClosed) and one.call.id == target), None)
