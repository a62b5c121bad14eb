"""Handles operators' answers: resolves them, has them applied, and replies to their senders."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, cast

from anytraverse.assessment import Assessment
from anytraverse.errors import RegionError
from anytraverse.memory import Memory
from anytraverse.operations import Operation, OtherPlace, taps_of
from anytraverse.regions import Box
from companion.calls.decisions import Call, Decision
from companion.calls.hold import Hold
from companion.calls.machine import OperatorCalls
from companion.calls.summary import flags
from companion.daemon.answers.outcome import (
    closed_call,
    outcome_text,
    refused_match_text,
    stale_text,
    unremembered,
)
from companion.link.answer_store import AnswerStore
from companion.vision.client import VISION_LOST, VisionClient, VisionResult
from companion.vision.messages import Done
from companion.wire import notices, texts
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import Kind, Motion, Outcome, Result, SenderId, Stage, words_hash

_VISION_BUSY = "vision is busy: send it again"
_NO_PICTURE = "no picture to tap in: say the word alone"
_JUST_MATCHED = "it matched just now: read which, then say so again"
_FRAME_PATIENCE = 10.0
"""Seconds after a restart in which answers get BUSY until the call's frame is judged again."""


@dataclass(frozen=True)
class Reply:
    """An acknowledgement to send.

    changed: the answer changed something, so that the acknowledgement is sent only once that is on disk.
    go: when the go that it confirms was received, monotonic seconds; None where it confirms none.
    """

    answer: Answer
    acknowledgement: Acknowledgement
    changed: bool = False
    go: float | None = None


@dataclass
class Handled:
    """The result of a message: decisions to execute first, then replies and notices to send.

    notices: which words' signs were turned, and who did it. They are sent once that is on disk.
    """

    decisions: list[Decision] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    refused: str = ""
    """Why a parameter was not set."""


@dataclass(frozen=True)
class _PendingAnswer:
    """An answer that waits for the vision process.

    target: the id that the answer was resolved to, 0 for words alone. number: its running number. at: when it
    was received, monotonic seconds.
    """

    answer: Answer
    target: int
    number: int
    at: float


class Sent(Protocol):
    """A request to set words without a call."""

    @property
    def sender(self) -> SenderId:
        """Who sent it."""


class AnswerHandler:
    """Passes answers to the vision process, which applies them in order, and replies to their senders.

    Only "stay" does not wait. It counts at once, whatever becomes of the words that come with it, and cancels
    the motion of all answers that still wait. A go counts once its answer is stored in the journal.
    """

    def __init__(
        self,
        calls: OperatorCalls,
        vision: VisionClient,
        store: AnswerStore,
        share: Callable[[SenderId], SenderId],
    ) -> None:
        """share: returns the key of a sender's share of the link."""
        self._calls = calls
        self._share = share
        self._vision = vision
        self._last_sent = self._last_applied = self._last_cancelled = 0
        self._matched_at = -math.inf
        self._store = store

    def receive(self, answer: Answer, now: float) -> Handled:
        """Handle an operator's answer."""
        stored = self._store.before_restart(answer)
        if stored is not None:
            return self._again(answer, stored)
        target = None if answer.refuses_match else self._calls.resolve(answer.target, now)
        # Words need no open call or hold; any other answer to nothing is stale.
        alone = answer.target == 0 and not self._calls.current_id
        if target is None and not answer.refuses_match and not (answer.operations and alone):
            text = stale_text(self._calls, answer.target)
            return self._reply(answer, answer.target, Result.STALE, text)
        decisions: list[Decision] = []
        if answer.motion is Motion.STAY:
            # Answers up to this one keep their words, and lose their motion.
            self._last_cancelled = self._last_sent
            # The words may wait for the vision process; the stay must not.
            if answer.operations and target:
                _, decisions = self._calls.apply_answer(target, Motion.STAY, (), None, now)
        handled = self._apply(answer, target, now)
        handled.decisions[:0] = decisions
        return handled

    def _apply(self, answer: Answer, target: int | None, now: float) -> Handled:
        operations = answer.changes
        taps = taps_of(operations)
        try:  # what is no box must not come to the state machine
            for tap in taps:
                Box(*tap.box)
        except RegionError as error:
            return self._reply(answer, target or 0, Result.REFUSED, str(error))
        if _refuses_any(operations) and now - self._matched_at < self._calls.numbers.announce_guard:
            # What a ground station repeats by itself must not count then: that is known of stale answers.
            result = Result.STALE if answer.refuses_match else Result.REFUSED
            return self._reply(answer, target or 0, result, _JUST_MATCHED)
        call = self._calls.call if target and self._calls.kind is Kind.CALL else None
        subject: Call | Hold | None = call
        if taps and call is None:
            subject = self._calls.hold if target else None
            if subject is None or subject.seen is None:
                return self._reply(answer, target or 0, Result.REFUSED, _NO_PICTURE)
        # A motion must not overtake an earlier answer that still waits for the vision process.
        in_order = call is None and self._last_sent == self._last_applied
        if not operations and (in_order or answer.motion is Motion.STAY):
            return self._apply_motion(answer, target or 0, now)
        return self._ask(answer, target or 0, subject, now)

    def _ask(self, answer: Answer, target: int, subject: Call | Hold | None, now: float) -> Handled:
        """Send an answer to the vision process. subject: its call or hold, None for words alone."""
        call = subject if isinstance(subject, Call) else None
        observation = subject.seen.observation if subject is not None and subject.seen is not None else None
        if call is not None and observation is None and now - call.opened_at < _FRAME_PATIENCE:
            return self._reply(
                answer, call.id, Result.BUSY, "the call's frame is being judged: send it again"
            )
        pending = _PendingAnswer(answer, target, self._last_sent + 1, now)
        go = answer.motion is Motion.GO
        number = subject.id if subject is not None else 0
        place = call.place if call is not None else None
        frame_id = observation.frame.id if observation is not None else 0
        operations = answer.changes
        # Another place may match before the vision process has this answer.
        adoption = self._vision.memory.adoption if _refuses_any(operations) else None
        if not self._vision.answer(
            pending,
            operations,
            frame_id=frame_id,
            call_id=number,
            go=go,
            place=place,
            match=adoption.clock if adoption is not None else None,
            owner=self._share(answer.sender),
        ):
            return self._reply(answer, target, Result.BUSY, _VISION_BUSY)
        self._last_sent = pending.number
        return Handled()

    def place_matched(self, now: float) -> None:
        """Note that a remembered scene has come into force."""
        self._matched_at = now
        self._store.forget_refused_matches()

    def set_words(self, request: Sent, operations: tuple[Operation, ...]) -> bool:
        """Set words and weights without a call. False where too many requests wait, or vision hangs.

        request: the token of its `Done`.
        """
        owner = self._share(request.sender)
        return self._vision.answer(request, operations, missing_ok=True, owner=owner)

    def applied(self, done: Done, result: VisionResult, now: float) -> Handled:
        """Handle the vision process's report for an answer or for words alone: applied or refused."""
        asked = result.token
        if isinstance(asked, _PendingAnswer):
            handled, sender = self._answered(asked, done, result.memory, now), asked.answer.sender
        else:
            handled, sender = Handled(refused=done.error), cast("Sent", asked).sender
        handled.notices = notices.words_turned(result.turned, sender)
        return handled

    def _answered(self, pending: _PendingAnswer, done: Done, memory: Memory, now: float) -> Handled:
        self._last_applied = pending.number
        if done.error:
            refused = Result.BUSY if done.error == VISION_LOST else Result.REFUSED
            return self._reply(pending.answer, pending.target, refused, done.error)
        outcome = done.outcome
        result, decisions = Result.APPLIED, list[Decision]()
        # The vision process may have hung meanwhile. A go is for now, so a late one does not count.
        go, cancelled = pending.answer.motion is Motion.GO, pending.number <= self._last_cancelled
        late = go and now - pending.at > self._calls.numbers.go_lasts
        if pending.target:
            motion = Motion.NONE if late or cancelled else pending.answer.motion
            result, decisions = self._calls.apply_answer(
                pending.target, motion, pending.answer.changes, outcome, now, go_at=pending.at
            )
        call_frame = outcome.call if outcome is not None else None
        newest = outcome.newest if outcome is not None else None
        text = outcome_text(self._calls, pending.target, result, decisions, call_frame, newest, memory)
        if (late or (go and cancelled)) and self._calls.current_id == pending.target:
            text = (texts.go_lapsed if late else texts.go_taken_back)(self._calls.kind, pending.target)
        if any(isinstance(one, OtherPlace) for one in pending.answer.operations):
            text = refused_match_text(text, forgotten=outcome is not None and bool(outcome.forgotten))
        if outcome is not None and outcome.dropped:
            text = f"{text}; {notices.word_dropped(', '.join(outcome.dropped))}"
        return self._reply(
            pending.answer,
            pending.target,
            result,
            text,
            decisions=decisions,
            call_frame=call_frame,
            newest=newest,
            changed=True,
            go=self._go(pending.answer, pending.at),
        )

    def written(self, reply: Reply, *, remembered: bool, now: float) -> Handled:
        """Complete a reply once its changes are on disk, or could not be written. Its go counts from now on.

        remembered: whether they are on disk.
        """
        ack = reply.acknowledgement if remembered else unremembered(reply.acknowledgement)
        decisions: list[Decision] = []
        if reply.go is not None:
            decisions = self._calls.confirm_go(reply.go, now)
            if self._calls.go_at is None:
                target = ack.target
                over = texts.fit(f"{target} is closed: the go came too late")
                taken_back = reply.go <= self._calls.holding.revoked_at
                void = texts.go_taken_back if taken_back else texts.go_lapsed
                text = void(self._calls.kind, target) if target == self._calls.current_id else over
                ack = replace(ack, text=text)
        return Handled(decisions, [Reply(reply.answer, ack)])

    def _go(self, answer: Answer, at: float) -> float | None:
        """Return `at` where the hold now waits to fulfil this answer's go, None elsewhere."""
        return at if answer.motion is Motion.GO and self._calls.go_at == at else None

    def _again(self, answer: Answer, stored: Acknowledgement) -> Handled:
        """Repeat a reply from before the restart.

        A go that was not fulfilled before the restart is void, and the reply says so.
        """
        void = answer.motion is Motion.GO and self._calls.go_at is None
        void = void and 0 != stored.target == self._calls.current_id
        text = texts.go_lapsed(self._calls.kind, stored.target) if void else stored.text
        return self._reply(answer, stored.target, stored.result, text)

    def _apply_motion(self, answer: Answer, target: int, now: float) -> Handled:
        """Apply an answer without words at once, since no frame needs to be judged again."""
        result, decisions = self._calls.apply_answer(target, answer.motion, (), None, now, go_at=now)
        newest = self._calls.reason_filter.newest
        text = outcome_text(self._calls, target, result, decisions, None, newest, None)
        changed, go = result is not Result.STALE, self._go(answer, now)
        return self._reply(
            answer, target, result, text, decisions=decisions, newest=newest, changed=changed, go=go
        )

    def _reply(
        self,
        answer: Answer,
        target: int,
        result: Result,
        text: str,
        *,
        decisions: Sequence[Decision] = (),
        call_frame: Assessment | None = None,
        newest: Assessment | None = None,
        changed: bool = False,
        go: float | None = None,
    ) -> Handled:
        closed = closed_call(decisions, target)
        roi, tile = (call_frame.roi, call_frame.tile) if call_frame is not None else (None, None)
        current = target and target == self._calls.current_id
        acknowledgement = Acknowledgement(
            transaction=answer.transaction,
            target=target,
            result=result,
            stage=self._calls.stage() if current else Stage.CLOSED,
            outcome=closed.outcome if closed else Outcome.NONE,
            roi_uncertainty=roi.uncertainty if roi else None,
            worst_tile=tile.uncertainty if tile else None,
            reasons=flags(newest.reasons) if newest is not None else flags(()),
            words=words_hash(self._vision.words),
            text=text,
        )
        return Handled(list(decisions), [Reply(answer, acknowledgement, changed, go)])


def _refuses_any(operations: Iterable[Operation]) -> bool:
    """Whether the newest match is refused, whichever it is."""
    return [one.id for one in operations if isinstance(one, OtherPlace)][-1:] == [0]
