"""Plays the operator's side: the client as it ships, and an operator who answers every call at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from anytraverse.operations import Operation, SetWord
from bench.link.synthetic_frames import thing
from companion.wire.answers import Answer
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus, Pending
from companion.wire.ids import Motion, Result
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.connection import OperatorConnection
from gcs_plugin.terminal.runner import Runner

SYSTEM = 1
_FINAL = (Result.APPLIED, Result.APPLIED_NOT_REMEMBERED, Result.STALE)
_WORDS = 10


@dataclass
class KnownCall:
    """A call as the operator knows it, times in s. answers: what was sent for it, in order."""

    heard_at: float
    answers: list[Pending] = field(default_factory=list)
    answered_at: float | None = None
    """When the operator knew that an answer had counted."""


class Operator:
    """Answers every call. `shown` returns what is ahead of the rover, as the call's picture would show it."""

    def __init__(self, connection: OperatorConnection, seed: str, shown: Callable[[], int]) -> None:
        random = Random(seed)
        self.client = OperatorClient(lambda: random.randrange(1, 1 << 32))
        self.calls: dict[int, KnownCall] = {}
        self._runner = Runner(connection, self.client)
        self._shown = shown
        self._number = 0

    def step(self, now: float) -> None:
        """Reads the client's events, answers calls and sends what is due."""
        self._runner.step(now)
        for event in self.client.events():
            self._hear(event, now)
        if SYSTEM not in self.client.rovers:
            return
        busy = {pending.answer.target for pending in self.client.unsettled}
        for call in self.client.rovers[SYSTEM].open_calls():
            known = self.calls.get(call.data.id)
            if known is not None and known.answered_at is None and call.data.id not in busy:
                known.answers.append(self._answer(call.data, now))

    def settled(self, number: int) -> bool:
        """Whether the operator knows that this call is answered, and nothing more is sent for it."""
        known = self.calls.get(number)
        return (
            known is not None and known.answered_at is not None and all(one.settled for one in known.answers)
        )

    def close(self) -> None:
        """Closes the link."""
        self._runner.close()

    def _hear(self, event: ev.Event, now: float) -> None:
        match event:
            case ev.LinkChanged(up=True):
                self.client.request_parameters(SYSTEM)
            case ev.CallAnnounced(call=call):
                self.calls.setdefault(call.id, KnownCall(now)).answered_at = None
            case ev.Acknowledged(acknowledgement=ack) if ack.target in self.calls and ack.result in _FINAL:
                self._known(ack.target, now)
            case ev.CallEnded(call=call) if call.id in self.calls:
                self._known(call.id, now)
            case _:
                pass

    def _known(self, number: int, now: float) -> None:
        known = self.calls[number]
        if known.answered_at is None:
            known.answered_at = now

    def _answer(self, call: CallReport, now: float) -> Pending:
        """Makes an answer, in turn: go; a word; a word and go; more words than one frame takes, and go."""
        self._number += 1
        name = SetWord(thing(self._shown()), 1.0)
        kind = self._number % 4
        if kind == 0:
            others = [SetWord(f"a thing of some length, {n}", -0.5) for n in range(_WORDS)]
            return self._send(call.id, Motion.GO, (*others, name), now)
        if kind == 1:
            return self._send(call.id, Motion.GO, (), now)
        return self._send(call.id, Motion.NONE if kind == 2 else Motion.GO, (name,), now)

    def _send(self, target: int, motion: Motion, operations: tuple[Operation, ...], now: float) -> Pending:
        return self.client.answer(SYSTEM, Answer(target, motion, operations), now)


def expired(known: KnownCall) -> int:
    """Counts the answers of a call that ran out of time."""
    return sum(one.status is DeliveryStatus.EXPIRED for one in known.answers)
