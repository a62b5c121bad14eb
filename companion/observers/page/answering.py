"""Delivers what is answered on the page to the supervisor, and knows what became of it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from companion.observers.page.news import SILENT, News
from companion.pages.given import Answered, OwnAnswers
from companion.pages.requests import (
    RequestError,
    check_answer,
    read_answer,
    read_incident,
    read_object,
    read_recording,
    whole,
)
from companion.wire.answers import (
    Acknowledgement,
    Answer,
    AnyOperation,
    PackIncident,
    RecordingWish,
    Wish,
)
from companion.wire.delivery import Pending, random_transaction
from companion.wire.documents import state_from
from companion.wire.ids import Motion, Result
from companion.wire.packing import PayloadError

MOST_WAITING = 8
_KEPT = 64


class Answering:
    """Takes answers from browsers. The supervisor is told each until it acknowledges, 60 s at most.

    revision: rises whenever something changed that the page shows. Who waits for news is woken then.
    """

    def __init__(
        self,
        news: News,
        send: Callable[[bytes, float], None],
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        """send: sends a payload to the supervisor, or drops it; it is told when. clock: monotonic s.

        wall: s since 1970.
        """
        self._news = news
        self._send = send
        self._clock = clock
        self._wall = wall
        self._answers: deque[Answered] = deque(maxlen=_KEPT)
        self._undone: dict[int, Pending] = {}
        """By call: what takes back the answers to it."""
        self._incidents: dict[int, Pending] = {}
        """As `Packed.call` has it: the newest request for an incident file."""
        self._deletions: dict[int, Pending] = {}
        """By number: the newest request to delete a recording."""
        self.revision = 0

    def answer(self, body: bytes) -> str:
        """Take an answer, or words. Returns what was done. Raises RequestError."""
        answer = read_answer(read_object(body))
        self._require_news()
        state = state_from(self._news.told.get("state", {}))
        call = state.open_call
        named = call if call is not None and call.id == answer.target else None
        check_answer(answer, named, call.id if call is not None else 0)
        pending = self._begin(answer)
        self._answers.append(Answered(pending, self._wall(), dict(state.words), named, state.tapped))
        self.deliver()
        return "sent"

    def undo(self, body: bytes) -> str:
        """Take back what was answered on the page to a call. Returns what was done. Raises RequestError."""
        number = whole(read_object(body), "call", 1, 0xFFFF)
        self._require_news()
        if state_from(self._news.told.get("state", {})).open_call is not None:
            raise RequestError("a call is open: answer it first, then undo")
        operations = self._of(number).undoing()
        if not operations:
            raise RequestError(f"nothing that was answered on this page to call {number} is left to undo")
        return self._ask(self._undone, number, operations)

    def incident(self, body: bytes) -> str:
        """Ask for an incident file. Returns what was done. Raises RequestError."""
        call = read_incident(read_object(body))
        self._require_news()
        return self._ask(self._incidents, call, (PackIncident(call),))

    def recording(self, body: bytes) -> str:
        """Ask to have a recording packed, packed no more, or deleted. Returns what was done.

        Raises RequestError.
        """
        number, wish = read_recording(read_object(body))
        self._require_news()
        operations = (RecordingWish(number, wish),)
        if wish is Wish.DELETE:
            return self._ask(self._deletions, number, operations)
        return self._ask(self._incidents, -number, operations)

    def _ask(self, requests: dict[int, Pending], call: int, operations: tuple[AnyOperation, ...]) -> str:
        """Send what answers no call, and keep it as the newest request about this one."""
        requests[call] = self._begin(Answer(0, Motion.NONE, operations))
        while len(requests) > _KEPT:
            requests.pop(next(iter(requests)))
        self.deliver()
        return "asked for"

    def asked_for_incident(self, call: int) -> Pending | None:
        """Return the newest request for an incident file of a call: as of `Packed`."""
        return self._incidents.get(call)

    def deletion(self, number: int) -> str:
        """Say how the newest request to delete a recording goes, "" without one."""
        asked = self._deletions.get(number)
        if asked is None or asked.applied:
            return ""
        return f"The request to delete it: {asked.told}." if asked.settled else "It is being deleted."

    def by_call(self) -> dict[int, OwnAnswers]:
        """Return what was answered to each call."""
        return {number: self._of(number) for number in {one.pending.answer.target for one in self._answers}}

    def _of(self, number: int) -> OwnAnswers:
        answers = [one for one in self._answers if one.pending.answer.target == number]
        return OwnAnswers(answers, self._undone.get(number))

    def deliver(self) -> None:
        """Send what is due. Called once a second, since what is not acknowledged is sent again.

        An answer waits for the one before it, but a stay does not.
        """
        now = self._clock()
        for pending in self._unsettled():
            if pending.settle(now):
                self._changed()
                continue
            while (payload := pending.due(now)) is not None:
                self._send(payload, now)
            if pending.blocks(now):
                return

    def acknowledge(self, payload: bytes) -> None:
        """Take an acknowledgement of the supervisor. Raises PayloadError."""
        ack = Acknowledgement.unpack(payload)
        for pending in self._unsettled():
            if pending.answer.transaction == ack.transaction:
                pending.acknowledge(ack, final=ack.result is not Result.BUSY)
                self._changed()
        self.deliver()

    def _changed(self) -> None:
        self.revision += 1
        self._news.wake()

    def _require_news(self) -> None:
        if self._news.trouble() == SILENT:
            raise RequestError(f"{SILENT}, so nothing was sent")

    def _begin(self, answer: Answer) -> Pending:
        if len(self._unsettled()) >= MOST_WAITING:
            raise RequestError(f"{MOST_WAITING} answers wait already: is the companion well?")
        try:
            pending = Pending(0, replace(answer, transaction=random_transaction()), self._clock())
        except PayloadError as error:
            raise RequestError(str(error)) from error
        pending.overrule(self._unsettled(), self._clock())
        self._changed()
        return pending

    def _unsettled(self) -> list[Pending]:
        """Return what waits for its acknowledgement, in the order in which it is sent."""
        alone = *self._undone.values(), *self._incidents.values(), *self._deletions.values()
        all_pending = [*(one.pending for one in self._answers), *alone]
        return sorted((one for one in all_pending if not one.settled), key=lambda one: one.urgency)
