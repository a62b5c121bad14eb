"""What is heard from operators, and what they are answered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from anytraverse.answers import Changes, Tap
from anytraverse.assessment import Assessment, Reason
from anytraverse.errors import AnyTraverseError
from anytraverse.memory import Memory
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.answers.store import AnswerStore, StoredReply
from companion.calls.decisions import Call, CallClosed, Decision, GoLapsed
from companion.calls.hold import Hold
from companion.calls.machine import OperatorCalls
from companion.link.inbound import AnswerRequest, SetRequest
from companion.telemetry.summary import blocked_text, flags
from companion.vision.client import Applied, Vision, VisionLostError
from companion.wire import notices, texts
from companion.wire.answers import (
    Acknowledgement,
    ForgetCall,
    ForgetWord,
    NewEpisode,
    Operation,
    SetWord,
    TapBox,
)
from companion.wire.ids import Kind, Motion, Outcome, Result, Stage, words_hash

_VISION_BUSY = "vision is busy: send it again"
_NO_PICTURE = "no picture to tap in: say the word alone"
_UNREMEMBERED = "not remembered (disk?): "
_FRAME_PATIENCE = 10.0
"""Seconds to wait after a restart for the call's frame to be judged; then answers do without it."""


@dataclass(frozen=True)
class Reply:
    """An acknowledgement. changed: something was, so that it leaves once everything that it says is on disk.

    go: when the go was given that it tells of, monotonic seconds; None where it tells of none.
    """

    request: AnswerRequest
    acknowledgement: Acknowledgement
    changed: bool = False
    go: float | None = None


@dataclass
class Handled:
    """What came of something heard: decisions to carry out first, then replies."""

    decisions: list[Decision] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)
    refused: str = ""
    """Why a parameter was not set."""


@dataclass(frozen=True)
class _Asked:
    """What an `Applied` belongs to. target: the id that the answer was resolved to, 0 for words alone."""

    request: AnswerRequest
    target: int
    changed: bool
    number: int
    at: float


def unremembered(acknowledgement: Acknowledgement) -> Acknowledgement:
    """The same when the journal could not be written: it may have been applied, but a restart forgets it."""
    if acknowledgement.result not in (Result.APPLIED, Result.NOT_COVERED):
        return acknowledgement
    text = _UNREMEMBERED + acknowledgement.text
    return replace(acknowledgement, result=Result.APPLIED_NOT_REMEMBERED, text=text)


def changes_of(operations: Iterable[Operation]) -> Changes:
    """The wire's operations as changes. Raises AnyTraverseError for a box that is none."""
    weights: dict[str, float] = {}
    taps: list[Tap] = []
    words: list[str] = []
    calls: list[int] = []
    new_episode = False
    for operation in operations:
        match operation:
            case SetWord(word, weight):
                weights[word] = weight
            case TapBox(frame_id, box, word, weight):
                taps.append(Tap(frame_id, Box(*box), word, weight))
            case ForgetWord(word):
                words.append(word)
            case ForgetCall(call_id):
                calls.append(call_id)
            case NewEpisode():
                new_episode = True
    return Changes(weights, tuple(taps), tuple(words), tuple(calls), new_episode)


class AnswerHandler:
    """Answers go to the vision process, which applies them in order; what came of it goes back to who asked.

    Only "stay" overtakes: it counts at once, whatever becomes of words that come with it, and takes the
    motion from what still waits for it. A go counts from when its answer is kept.
    """

    def __init__(
        self, calls: OperatorCalls, vision: Vision, words: Preferences, replies: AnswerStore
    ) -> None:
        self._calls = calls
        self._vision = vision
        self.words = words
        """The words in force, as far as the vision process has told."""
        self._asked = self._applied = self._overruled = 0
        self._replies = replies

    def hear(self, request: AnswerRequest, now: float) -> Handled:
        """An operator's answer."""
        kept = self._replies.before_restart(request)
        if kept is not None:
            return self._again(request, kept)
        target = self._calls.resolve(request.target, now)
        if target is None and not (request.operations and request.target == 0 and not self._calls.current_id):
            return self._stale(request)
        decisions: list[Decision] = []
        if request.motion is Motion.STAY:
            self._overruled = self._asked
            if (
                request.operations and target
            ):  # what it teaches may wait for vision, what it takes back may not
                _, decisions = self._calls.answered(target, Motion.STAY, False, None, now)  # noqa: FBT003
        heard = self._apply(request, target, now)
        heard.decisions[:0] = decisions
        return heard

    def _apply(self, request: AnswerRequest, target: int | None, now: float) -> Handled:
        try:
            changes = changes_of(request.operations)
        except AnyTraverseError as error:
            return self._reply(request, target or 0, Result.REFUSED, str(error))
        call = self._calls.call if target and self._calls.kind is Kind.CALL else None
        subject: Call | Hold | None = call
        if changes.taps and call is None:
            subject = self._calls.hold if target else None
            if subject is None or subject.seen is None:
                return self._reply(request, target or 0, Result.REFUSED, _NO_PICTURE)
        in_order = call is None and self._asked == self._applied
        if not changes and (in_order or request.motion is Motion.STAY):
            return self._moved(request, target or 0, now)
        return self._ask(request, target or 0, changes, subject, now)

    def _ask(
        self, request: AnswerRequest, target: int, changes: Changes, subject: Call | Hold | None, now: float
    ) -> Handled:
        """Have the vision process apply an answer. subject: what it is about, None: words alone."""
        call = subject if isinstance(subject, Call) else None
        observation = subject.seen.observation if subject is not None and subject.seen is not None else None
        if call is not None and observation is None and now - call.opened_at < _FRAME_PATIENCE:
            return self._reply(
                request, call.id, Result.BUSY, "the call's frame is being judged: send it again"
            )
        asked = _Asked(request, target, bool(changes), self._asked + 1, now)
        go = request.motion is Motion.GO
        number = subject.id if subject is not None else 0
        place = call.place if call is not None else None
        frame_id = observation.frame.id if observation is not None else 0
        if not self._vision.answer(asked, changes, frame_id=frame_id, call_id=number, go=go, place=place):
            return self._reply(request, target, Result.BUSY, _VISION_BUSY)
        self._asked = asked.number
        return Handled()

    def set_words(self, request: SetRequest, operations: Iterable[Operation]) -> bool:
        """Words and weights without a call. False when too many wait, or vision hangs."""
        changes = replace(changes_of(operations), missing_ok=True)
        return self._vision.answer(request, changes)

    def applied(self, applied: Applied, now: float) -> Handled:
        """The vision process has applied an answer, or refused it."""
        self.words = applied.memory.preferences
        if isinstance(applied.token, SetRequest):
            return Handled(refused=str(applied.error or ""))
        if not isinstance(applied.token, _Asked):
            return Handled()
        asked = applied.token
        self._applied = asked.number
        if isinstance(applied.error, VisionLostError):
            return self._reply(asked.request, asked.target, Result.BUSY, str(applied.error))
        if applied.error is not None:
            return self._reply(asked.request, asked.target, Result.REFUSED, str(applied.error))
        outcome = applied.outcome
        result, decisions = Result.APPLIED, list[Decision]()
        # Vision may have hung in between, and a go is for now.
        go, overruled = asked.request.motion is Motion.GO, asked.number <= self._overruled
        late = go and now - asked.at > self._calls.numbers.go_lasts
        if asked.target:
            motion = Motion.NONE if late or overruled else asked.request.motion
            result, decisions = self._calls.answered(
                asked.target, motion, asked.changed, outcome, now, go_at=asked.at
            )
        call_frame = outcome.call if outcome is not None else None
        newest = outcome.newest if outcome is not None else None
        text = self._outcome_text(asked.target, result, decisions, call_frame, newest, applied.memory)
        if (late or (go and overruled)) and self._calls.current_id == asked.target:
            text = (texts.go_lapsed if late else texts.go_taken_back)(self._calls.kind, asked.target)
        if outcome is not None and outcome.dropped:
            text = f"{text}; {notices.word_dropped(', '.join(outcome.dropped))}"
        heard = self._reply(
            asked.request,
            asked.target,
            result,
            text,
            decisions=decisions,
            call_frame=call_frame,
            newest=newest,
            changed=True,
            go=self._go(asked.request, asked.at),
        )
        heard.decisions = decisions
        return heard

    def kept(self, reply: Reply, *, remembered: bool, now: float) -> Handled:
        """What a reply says is on disk, or could not be put there: its go counts now, and it may leave."""
        acknowledgement = reply.acknowledgement if remembered else unremembered(reply.acknowledgement)
        decisions: list[Decision] = []
        if reply.go is not None:
            decisions = self._calls.go_kept(reply.go, now)
            if self._calls.go_at is None:
                target = acknowledgement.target
                over = texts.fit(f"{target} is closed: the go came too late")
                taken_back = reply.go <= self._calls.holding.taken_back_at
                void = texts.go_taken_back if taken_back else texts.go_lapsed
                text = void(self._calls.kind, target) if target == self._calls.current_id else over
                acknowledgement = replace(acknowledgement, text=text)
        return Handled(decisions, [Reply(reply.request, acknowledgement)])

    def _go(self, request: AnswerRequest, at: float) -> float | None:
        """When the go was given that the hold waits to fulfil since this request."""
        return at if request.motion is Motion.GO and self._calls.go_at == at else None

    def _again(self, request: AnswerRequest, kept: StoredReply) -> Handled:
        """What was answered before the restart, which a go that was not fulfilled did not survive."""
        void = request.motion is Motion.GO and self._calls.go_at is None
        void = void and 0 != kept.target == self._calls.current_id
        text = texts.go_lapsed(self._calls.kind, kept.target) if void else kept.text
        return self._reply(request, kept.target, kept.result, text)

    def _stale(self, request: AnswerRequest) -> Handled:
        current = self._calls.current_id
        if request.target == 0 and current:
            text = texts.just_announced(self._calls.kind, current)
        else:
            text = texts.stale(request.target)
        return self._reply(request, request.target, Result.STALE, text)

    def _moved(self, request: AnswerRequest, target: int, now: float) -> Handled:
        """Motion alone, where no frame needs to be judged again."""
        result, decisions = self._calls.answered(
            target,
            request.motion,
            False,  # noqa: FBT003
            None,
            now,
            go_at=now,
        )
        newest = self._calls.reason_filter.newest
        text = self._outcome_text(target, result, decisions, None, newest, None)
        changed, go = result is not Result.STALE, self._go(request, now)
        heard = self._reply(
            request, target, result, text, decisions=decisions, newest=newest, changed=changed, go=go
        )
        heard.decisions = decisions
        return heard

    def _reply(
        self,
        request: AnswerRequest,
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
        closed = _closed(decisions, target)
        roi, tile = (call_frame.roi, call_frame.tile) if call_frame is not None else (None, None)
        current = target and target == self._calls.current_id
        acknowledgement = Acknowledgement(
            transaction=request.transaction or 0,
            target=target,
            result=result,
            stage=self._calls.stage() if current else Stage.CLOSED,
            outcome=closed.call.outcome if closed else Outcome.NONE,
            roi_uncertainty=roi.uncertainty if roi else None,
            worst_tile=tile.uncertainty if tile else None,
            reasons=flags(newest.reasons) if newest is not None else flags(()),
            words=words_hash(self.words),
            text=text,
        )
        return Handled(replies=[Reply(request, acknowledgement, changed, go)])

    def _outcome_text(
        self,
        target: int,
        result: Result,
        decisions: Sequence[Decision],
        call_frame: Assessment | None,
        newest: Assessment | None,
        memory: Memory | None,
    ) -> str:
        """What a person is told of an answer that was applied."""
        if not target:
            return f"in use: {memory.preferences.format()}" if memory is not None else "nothing changed"
        if result is Result.STALE:
            return self._too_late(target, memory)
        call = self._calls.call if self._calls.current_id == target else None
        closed = _closed(decisions, target)
        if result is Result.NOT_COVERED and call_frame is not None:
            if Reason.UNKNOWN_OBJECT in call_frame.reasons or call_frame.roi is None:
                return texts.still_unknown(target, call_frame.roi.uncertainty if call_frame.roi else None)
            return texts.still_new(target, call_frame.similarity)
        if closed is not None:
            return texts.closed(Kind.CALL, target, closed.call.outcome)
        kind = self._calls.kind
        if newest is not None and Reason.BLOCKED in newest.reasons:
            return blocked_text(newest, target, kind)
        if self._calls.go_at is not None:
            return texts.waiting_for_view(kind, target)
        if any(isinstance(decision, GoLapsed) for decision in decisions):
            return texts.fit(f"{texts.name(kind, target)} no go: disarmed, or no autopilot")
        if self._calls.stage() is Stage.CLEAR:
            return texts.clear(kind, target)
        if call is not None and call.answered:
            return texts.answered_waiting(kind, target)
        return texts.fit(f"{texts.name(kind, target)} noted: still {'open' if call else 'holding'}")

    def _too_late(self, target: int, memory: Memory | None) -> str:
        """The id was closed while the answer was applied: what it taught is in force all the same."""
        if memory is None:
            return texts.stale(target)
        return f"{target} is closed; in use: {memory.preferences.format()}"


def _closed(decisions: Sequence[Decision], target: int) -> CallClosed | None:
    return next((one for one in decisions if isinstance(one, CallClosed) and one.call.id == target), None)
