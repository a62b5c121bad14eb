"""What the client tells those who sit on it. All times are those of the `now` that was handed in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from companion.wire.answers import Acknowledgement
from companion.wire.ids import Policy, State
from companion.wire.payloads import CallData, Summary
from gcs_plugin.client.delivery import PolicyRequested, Status


@dataclass(frozen=True)
class LinkChanged:
    """The companion's heartbeat came (first or again), or has been away for 3 s."""

    event: ClassVar = "link"
    system: int
    up: bool


@dataclass(frozen=True)
class StateChanged:
    """The companion's state or its current call or hold (0: none), from its heartbeat."""

    event: ClassVar = "state"
    system: int
    state: State
    current_id: int


@dataclass(frozen=True)
class VehicleChanged:
    """The autopilot's mode or arming."""

    event: ClassVar = "vehicle"
    system: int
    mode: str
    armed: bool


@dataclass(frozen=True)
class CallOpened:
    """A call or hold that was not known."""

    event: ClassVar = "call"
    system: int
    call: CallData


@dataclass(frozen=True)
class CallChanged:
    """An open one reached another stage, has other reasons, or the vehicle stands or moves now."""

    event: ClassVar = "call_changed"
    system: int
    call: CallData


@dataclass(frozen=True)
class CallClosed:
    """One that was open is closed. after_s: since it was announced.

    Its outcome is NONE when only the heartbeat told, and the closing message was lost.
    """

    event: ClassVar = "closed"
    system: int
    call: CallData
    after_s: float


@dataclass(frozen=True)
class SummaryHeard:
    """A summary, as it came."""

    event: ClassVar = "summary"
    system: int
    summary: Summary


@dataclass(frozen=True)
class TextHeard:
    """A STATUSTEXT of the companion; severity as in MAV_SEVERITY."""

    event: ClassVar = "text"
    system: int
    severity: int
    text: str


@dataclass(frozen=True)
class VehicleTextHeard:
    """A STATUSTEXT of the autopilot, WARNING or worse, that is not the companion's said again."""

    event: ClassVar = "vehicle_text"
    system: int
    severity: int
    text: str


@dataclass(frozen=True)
class ParameterHeard:
    """A parameter of the companion that is new or has changed."""

    event: ClassVar = "parameter"
    system: int
    name: str
    value: float


@dataclass(frozen=True)
class AnswerMoved:
    """An answer is sent, waits for the rover, was closed over or has run out of time."""

    event: ClassVar = "answer"
    system: int
    target: int
    transaction: int
    status: Status


@dataclass(frozen=True)
class Acknowledged:
    """The rover's word on an answer; BUSY: it will be sent again."""

    event: ClassVar = "ack"
    system: int
    acknowledgement: Acknowledgement


@dataclass(frozen=True)
class PolicyMoved:
    """A policy was asked for, waits for the rover, or what became of it."""

    event: ClassVar = "policy"
    system: int
    policy: Policy
    status: PolicyRequested


@dataclass(frozen=True)
class NotUnderstood:
    """Something of the companion could not be read; each problem is told once."""

    event: ClassVar = "not_understood"
    system: int
    problem: str


Event = (
    LinkChanged
    | StateChanged
    | VehicleChanged
    | CallOpened
    | CallChanged
    | CallClosed
    | SummaryHeard
    | TextHeard
    | VehicleTextHeard
    | ParameterHeard
    | AnswerMoved
    | Acknowledged
    | PolicyMoved
    | NotUnderstood
)
