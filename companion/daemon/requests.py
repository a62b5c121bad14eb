"""Handles what operators ask for: answers, settings, policy, incidents. What changes is stored, then told."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

from anytraverse.memory import Memory
from companion.daemon.answers.handler import AnswerHandler, Handled, Reply
from companion.daemon.executor import DecisionExecutor
from companion.daemon.persistence import Persistence
from companion.daemon.settings.service import SettingsService
from companion.daemon.turn import AnswerStored
from companion.link.inbound import InboundEvent, ParameterRequest, PolicyRequest, RcChannels, ResetRequest
from companion.link.link import Link
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Done
from companion.wire import notices
from companion.wire.answers import (
    Acknowledgement,
    Answer,
    CancelIncident,
    FilesRequest,
    PackIncident,
    RecordingWish,
    Via,
    Wish,
)
from companion.wire.ids import ERROR, NOTICE, Motion, Result, words_hash

log = logging.getLogger(__name__)


class Receiver(Protocol):
    """Takes answers that are for no call of the state machine."""

    def receive(self, answer: Answer, now: float) -> bool:
        """Take an answer and acknowledge it, if it is for this one. Whether it was."""


class Requests:
    """Has each request decided and carried out. What changes is acknowledged only once it is on disk."""

    def __init__(
        self,
        link: Link,
        executor: DecisionExecutor,
        persistence: Persistence,
        settings: SettingsService,
        answer_handler: AnswerHandler,
        receivers: Sequence[Receiver],
    ) -> None:
        """receivers: are asked first whether an answer is for them."""
        self._link = link
        self._executor = executor
        self._persistence = persistence
        self._settings = settings
        self._answer_handler = answer_handler
        self._receivers = receivers

    def received(self, event: InboundEvent, now: float) -> None:
        """Handle a request that the link received."""
        match event:
            case ParameterRequest() | ResetRequest() | Answer(via=Via.TEXT):
                self._finish(self._settings.set(event, now), now)
            case Answer():
                if not any(one.receive(event, now) for one in self._receivers):
                    self._finish(self._answer_handler.receive(event, now), now)
            case PolicyRequest():
                self._executor.carry_out(self._settings.policy.command(event, now), now)
            case RcChannels():
                self._executor.carry_out(self._settings.policy.rc_channels_received(event, now), now)

    def applied(self, done: Done, result: VisionResult, now: float) -> None:
        """Finish an answer, or words alone, that vision has applied or refused."""
        handled = self._answer_handler.applied(done, result, now)
        if handled.refused:
            self._link.texts.send(notices.refused(handled.refused), ERROR, now)
        self._finish(handled, now)
        for text in handled.notices:
            log.warning("%s", text)
            self._persistence.after_write(partial(self._tell_turned, text))
        answered = self._settings.words.answered
        self._persistence.after_write(lambda stored, now: answered(done, result, stored, now))

    def store(self, memory: Memory, now: float) -> None:
        """Queue the changes of this turn for the disk, and tell the ground of settings that are on it.

        memory: the one in use.
        """
        self._persistence.save_calls(self._settings.saved(now), now)
        if self._persistence.memory_stored(now, memory):
            self._settings.send_changes(now)

    def acknowledge_stored(self, now: float) -> None:
        """Acknowledge what has waited for the disk, and put it in force."""
        for callback, stored in self._persistence.due(now):
            with self._executor.error_guard.survived("acknowledgement", now):
                callback(stored, now)

    def _tell_turned(self, text: str, _stored: bool, now: float) -> None:
        self._link.texts.send(text, NOTICE, now)

    def _finish(self, handled: Handled, now: float) -> None:
        """Carry out the decisions of an answer and acknowledge it.

        An acknowledgement of a change waits until the change is on disk.
        """
        self._executor.carry_out(handled.decisions, now)
        for reply in handled.replies:
            if reply.changed:
                record = self._persistence.save_answer(reply)
                if record is not None:
                    self._executor.events.append(AnswerStored(reply.acknowledgement.target, record))
                self._persistence.after_write(partial(self._stored, reply))
            else:
                ack = reply.acknowledgement
                self._link.answers.acknowledge(reply.answer, ack, now)
                self._executor.events.append(reply)
                log.info("answer to %d: %s %s", ack.target, ack.result.name, ack.text)

    def _stored(self, reply: Reply, stored: bool, now: float) -> None:
        self._finish(self._answer_handler.written(reply, remembered=stored, now=now), now)


class Packer(Protocol):
    """Packs incidents, see `IncidentPacker`."""

    def ask(self, call: int, now: float) -> tuple[Result, str]:
        """Have one packed. Returns what the requester is told."""

    def cancel(self, call: int, now: float) -> tuple[Result, str]:
        """Have it packed no more. Returns what the requester is told."""


class Deleter(Protocol):
    """Deletes recordings, see `RecordingDeleter`."""

    def ask(self, number: int, tell: Callable[[Result, str], None]) -> None:
        """Have one deleted. tell: told what became of it, later."""


class FilesRequests:
    """Answers requests about incident files and recordings, which answer no call, and teach nothing.

    packer, deleter: None: nothing is packed or deleted.
    """

    def __init__(self, link: Link, vision: VisionClient) -> None:
        self._link = link
        self._vision = vision
        self.packer: Packer | None = None
        self.deleter: Deleter | None = None

    def receive(self, answer: Answer, now: float) -> bool:
        """Take an answer, if it is such a request. Whether it was."""
        if not any(isinstance(one, FilesRequest) for one in answer.operations):
            return False
        deletes = any(isinstance(one, RecordingWish) and one.wish is Wish.DELETE for one in answer.operations)
        result, text = self._delete(answer) if deletes else self._pack(answer, now)
        if text:
            self._tell(answer, result, text, now)
        return True

    def _pack(self, answer: Answer, now: float) -> tuple[Result, str]:
        if len(answer.operations) != 1 or answer.motion is not Motion.NONE:
            return _ALONE
        if self.packer is None:
            return Result.REFUSED, "nothing is packed here"
        match answer.operations[0]:
            case PackIncident(call_id):
                return self.packer.ask(call_id, now)
            case CancelIncident(call_id):
                return self.packer.cancel(call_id, now)
            case RecordingWish(number, Wish.PACK):
                return self.packer.ask(-number, now)
            case RecordingWish(number, Wish.CANCEL):
                return self.packer.cancel(-number, now)
        return _ALONE

    def _delete(self, answer: Answer) -> tuple[Result, str]:
        """Have a recording deleted. Returns why not; no text where it is told later what became of it."""
        match answer.operations:
            case (RecordingWish(number),) if answer.motion is Motion.NONE:
                if answer.via is not Via.PAGE or self.deleter is None:
                    return Result.REFUSED, "a recording is deleted on the rover's own page"
                self.deleter.ask(
                    number, lambda result, text: self._tell(answer, result, text, time.monotonic())
                )
                return Result.APPLIED, ""
        return _ALONE

    def _tell(self, answer: Answer, result: Result, text: str, now: float) -> None:
        ack = Acknowledgement.without_figures(answer.transaction, 0, result, text)
        self._link.answers.acknowledge(answer, replace(ack, words=words_hash(self._vision.words)), now)
        log.info("files: %s %s", ack.result.name, ack.text)


_ALONE = Result.REFUSED, "a request about files comes alone, without motion or words"
