"""Defines the events that the link reports to the daemon."""

from __future__ import annotations

from dataclasses import dataclass

from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.state import Vehicle
from companion.wire.answers import Operation
from companion.wire.ids import Motion, Policy

Sender = tuple[int, int]
"""System and component id."""

_SHORTEST, _LONGEST = 800, 2200
"""us. MAVLink's 0 and 65535 mean that a channel does not exist."""


@dataclass(frozen=True)
class VehicleUpdate:
    """The autopilot sent a heartbeat, mode or position."""

    vehicle: Vehicle


@dataclass(frozen=True)
class AnswerRequest:
    """An operator's answer, complete and well-formed. Reply with `Link.acknowledge`.

    transaction: None for a command. target: id of the call or hold, 0 for the current one.
    value: that AT_ANSWER was set to; None for an answer that came otherwise.
    """

    sender: Sender
    transaction: int | None
    target: int
    motion: Motion
    operations: tuple[Operation, ...]
    value: float | None = None


@dataclass(frozen=True)
class ParameterRequest:
    """A request to set a parameter to a value in its range. Reply with `Link.set_parameter`."""

    sender: Sender
    name: str
    value: float


@dataclass(frozen=True)
class WordsRequest:
    """A request to set words as text, without a call. Reply with `Link.acknowledge_words`.

    name: the extended parameter. raw: its value as received.
    """

    sender: Sender
    name: str
    raw: bytes
    operations: tuple[Operation, ...]


@dataclass(frozen=True)
class ResetRequest:
    """A request to reset all settings as configured. Reply with `Link.acknowledge_command`. Idempotent."""

    sender: Sender


@dataclass(frozen=True)
class PolicyRequest:
    """A command to set the policy. Reply with `Link.acknowledge_command`. Idempotent."""

    sender: Sender
    policy: Policy


@dataclass(frozen=True)
class RcChannels:
    """The remote control's newest channels. widths: us, of channels 1 to 18. count: channels in use."""

    widths: tuple[int, ...]
    count: int

    def of(self, channel: int) -> int | None:
        """The width in us of `channel` (1 to 18); None when it is not in use or outside 800 to 2200."""
        if channel > min(self.count, len(self.widths)):
            return None
        width = self.widths[channel - 1]
        return width if _SHORTEST <= width <= _LONGEST else None


@dataclass(frozen=True)
class ModeAck:
    """The autopilot's reply to a mode command, for the log only: the mode that it reports counts.

    result: MAV_RESULT.
    """

    accepted: bool
    result: int


SetRequest = ParameterRequest | WordsRequest | ResetRequest
InboundEvent = VehicleUpdate | AnswerRequest | SetRequest | PolicyRequest | RcChannels | ModeAck | ScriptHold
