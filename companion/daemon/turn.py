"""Defines what observers are told of each turn of the main loop, and shows it to them."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from anytraverse.assessment import Assessment
from anytraverse.history import Place
from anytraverse.preferences import Preferences
from companion.calls.decisions import Call, Decision
from companion.calls.mode_monitor import ModeReport
from companion.daemon.answers.handler import Reply
from companion.link.inbound import InboundEvent
from companion.system.error_guard import ErrorGuard
from companion.vehicle.state import Vehicle
from companion.vision.client import VisionResult
from companion.vision.messages import FrameJudged
from companion.wire.call_report import CallReport
from companion.wire.ids import ERROR, Policy, State

log = logging.getLogger(__name__)

SLOW = 0.1
"""Seconds from which on an observer is named in the log: a turn is to take a fraction of that."""
_NAMED_EVERY = 10.0


@dataclass(frozen=True)
class CallShown:
    """The frame by which a call or hold is shown from now on.

    number: its id. call: None for a hold's. title: of its picture. drawing: number of vision's request, 0:
    vision cannot draw it now, None: the frame is the same, and is kept already. replaced: it takes the place
    of one that is lost.
    """

    number: int
    seen: Assessment
    call: Call | None
    title: str
    drawing: int | None
    replaced: bool = False


class AnswerStored(NamedTuple):
    """An answer that changed something was queued for the journal. record: as it is there, with its time."""

    target: int
    record: Mapping[str, Any]


class Decided(NamedTuple):
    """A decision that was carried out, with what was so then: much may change until the turn is told.

    decision: its call or hold is a copy. report: the autopilot's newest one. fault_name: what was wrong, in
    two or three words. at: seconds since 1970.
    """

    decision: Decision
    report: ModeReport
    fault_name: str
    at: float


Event = InboundEvent | VisionResult | Decided | CallShown | AnswerStored | Reply
"""A `Reply` is an acknowledgement that was sent."""


class Reminder(NamedTuple):
    """The text to repeat while no call and no hold is open, "" for none. data: of an open test call."""

    text: str
    severity: int = ERROR
    quiet: bool = False
    data: CallReport | None = None


@dataclass(frozen=True)
class Turn:
    """One turn of the main loop, after all was decided and queued for the disk, and before it is sent.

    now: monotonic seconds. current_id: of the open call or hold, 0 for none. words: in use. weak: those of
    them that the perceiver recognises badly. link_trouble: where and why nothing can be sent, "" when all is
    well. computer: figures of `Computer`. silent: the parts that give no sign of life. fault: why nothing can
    be judged, "" while it can. test_call: `TrialCall.status`. events: what happened since the turn before, in
    order.
    """

    now: float
    state: State
    policy: Policy
    current_id: int
    words: Preferences
    weak: Sequence[str]
    place: Place
    vehicle: Vehicle | None
    link_trouble: str
    computer: Mapping[str, Any]
    silent: Sequence[str]
    fault: str
    reminder: Reminder
    test_call: Mapping[str, Any]
    events: tuple[Event, ...]

    @property
    def judged(self) -> Iterator[FrameJudged]:
        """The frames that were judged, oldest first."""
        results = (event for event in self.events if isinstance(event, VisionResult))
        return (one.report for one in results if isinstance(one.report, FrameJudged))


class Observer:
    """Is told of each turn, and tells somebody of it. It decides nothing, and must not wait.

    What it raises is logged and reported, and costs nothing but that one event, or that one `see`.
    """

    def happened(self, event: Event, turn: Turn) -> None:
        """Take an event of the turn. Called for each in order, before `see`."""

    def see(self, turn: Turn) -> None:
        """See the turn as a whole."""


class Observers:
    """Shows each turn to all observers, in order. One that fails or is slow is named."""

    def __init__(self, observers: Sequence[Observer], error_guard: ErrorGuard) -> None:
        self._observers = list(observers)
        self._error_guard = error_guard
        self._named_at: dict[str, float] = {}

    def add(self, observer: Observer) -> None:
        """Show the turns to this one, too, after the others."""
        self._observers.append(observer)

    def see(self, turn: Turn) -> None:
        """Show them a turn."""
        ended = time.monotonic()
        for observer in self._observers:
            began, name = ended, type(observer).__name__
            for event in turn.events:
                with self._error_guard.survived(f"{name}: {kind_of(event).__name__}", turn.now):
                    observer.happened(event, turn)
            with self._error_guard.survived(name, turn.now):
                observer.see(turn)
            ended = time.monotonic()
            took = ended - began
            if took >= SLOW and turn.now - self._named_at.get(name, float("-inf")) >= _NAMED_EVERY:
                self._named_at[name] = turn.now
                log.warning("%s made a turn of the main loop %.2f s longer", name, took)


def kind_of(event: Event) -> type:
    """Return the type of what happened: of a report of vision, of a decision, else of the event."""
    match event:
        case VisionResult(report):
            return type(report)
        case Decided(decision):
            return type(decision)
    return type(event)
