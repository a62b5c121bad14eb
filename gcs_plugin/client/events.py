"""Defines the events that the client reports. All times are those of the `now` passed to the client."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from companion.wire.answers import Acknowledgement
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus
from companion.wire.ids import Policy, State
from companion.wire.payloads import Summary
from gcs_plugin.client.policy_request import PolicyStatus


@dataclass(frozen=True)
class LinkChanged:
    """Reports that the companion's heartbeat came (for the first time or again), or is missing for 3 s."""

    event: ClassVar = "link"
    system: int
    up: bool


@dataclass(frozen=True)
class StateChanged:
    """Reports a new state of the companion, or a new current call or hold (0: none), from its heartbeat."""

    event: ClassVar = "state"
    system: int
    state: State
    current_id: int


@dataclass(frozen=True)
class VehicleChanged:
    """Reports a change of the autopilot's mode or arming."""

    event: ClassVar = "vehicle"
    system: int
    mode: str
    armed: bool


@dataclass(frozen=True)
class CallAnnounced:
    """Reports a new call or hold."""

    event: ClassVar = "call"
    system: int
    call: CallReport


@dataclass(frozen=True)
class CallChanged:
    """Reports that an open call or hold has another stage or reasons, or that holding began or ended."""

    event: ClassVar = "call_changed"
    system: int
    call: CallReport


@dataclass(frozen=True)
class CallEnded:
    """Reports that an open call or hold is closed. after_s: seconds since it was announced.

    Its outcome is NONE when the closing message was lost and only the heartbeat shows that it is closed.
    """

    event: ClassVar = "closed"
    system: int
    call: CallReport
    after_s: float


@dataclass(frozen=True)
class SummaryReceived:
    """Reports a summary."""

    event: ClassVar = "summary"
    system: int
    summary: Summary


@dataclass(frozen=True)
class TextReceived:
    """Reports a STATUSTEXT of the companion; severity as in MAV_SEVERITY."""

    event: ClassVar = "text"
    system: int
    severity: int
    text: str


@dataclass(frozen=True)
class VehicleTextReceived:
    """Reports a STATUSTEXT of the autopilot, WARNING or worse, that does not repeat one of the companion."""

    event: ClassVar = "vehicle_text"
    system: int
    severity: int
    text: str


@dataclass(frozen=True)
class ParameterReceived:
    """Reports a parameter of the companion that is new or has changed."""

    event: ClassVar = "parameter"
    system: int
    name: str
    value: float


@dataclass(frozen=True)
class AnswerStatusChanged:
    """Reports a new status of an answer."""

    event: ClassVar = "answer"
    system: int
    target: int
    transaction: int
    status: DeliveryStatus


@dataclass(frozen=True)
class Acknowledged:
    """Reports the rover's acknowledgement of an answer; BUSY: the answer will be sent again."""

    event: ClassVar = "ack"
    system: int
    acknowledgement: Acknowledgement


@dataclass(frozen=True)
class PolicyStatusChanged:
    """Reports a new status of a policy request."""

    event: ClassVar = "policy"
    system: int
    policy: Policy
    status: PolicyStatus


@dataclass(frozen=True)
class NotUnderstood:
    """Reports that a message of the companion could not be read; each problem is reported once."""

    event: ClassVar = "not_understood"
    system: int
    problem: str


Event = (
    LinkChanged
    | StateChanged
    | VehicleChanged
    | CallAnnounced
    | CallChanged
    | CallEnded
    | SummaryReceived
    | TextReceived
    | VehicleTextReceived
    | ParameterReceived
    | AnswerStatusChanged
    | Acknowledged
    | PolicyStatusChanged
    | NotUnderstood
)
