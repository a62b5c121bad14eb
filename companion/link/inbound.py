"""What the link reports to the daemon."""

from __future__ import annotations

from dataclasses import dataclass

from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.state import Vehicle
from companion.wire.answers import Operation
from companion.wire.ids import Motion, Policy

Sender = tuple[int, int]
"""System and component id."""

_SHORTEST, _LONGEST = 800, 2200
"""us; MAVLink's 0 and 65535 mean that a channel is not there."""


@dataclass(frozen=True)
class VehicleHeard:
    """A heartbeat or a position came."""

    vehicle: Vehicle


@dataclass(frozen=True)
class AnswerRequest:
    """An operator's answer, whole and well-formed; `Link.acknowledge` it. transaction: None for a command.

    target: id of the call or hold, 0 for the current one. value: of AT_ANSWER, where that parameter was set.
    """

    sender: Sender
    transaction: int | None
    target: int
    motion: Motion
    operations: tuple[Operation, ...]
    value: float | None = None


@dataclass(frozen=True)
class ParameterRequest:
    """A value to set, already in range; `Link.set_parameter` answers it."""

    sender: Sender
    name: str
    value: float


@dataclass(frozen=True)
class WordsRequest:
    """Words to set by text, without a call; `Link.acknowledge_words` it.

    name: the extended parameter. raw: its value as it came.
    """

    sender: Sender
    name: str
    raw: bytes
    operations: tuple[Operation, ...]


@dataclass(frozen=True)
class ResetRequest:
    """All shall be as configured; `Link.acknowledge_command` it. The same again is harmless."""

    sender: Sender


@dataclass(frozen=True)
class PolicyRequest:
    """A policy to set, by command; `Link.acknowledge_command` it. The same again changes nothing."""

    sender: Sender
    policy: Policy


@dataclass(frozen=True)
class Pulses:
    """What the remote control says: widths in us of channels 1 to 18 as they came, and how many count."""

    widths: tuple[int, ...]
    count: int

    def of(self, channel: int) -> int | None:
        """Channel 1 to 18's width, None where the receiver has none that makes sense."""
        if channel > min(self.count, len(self.widths)):
            return None
        width = self.widths[channel - 1]
        return width if _SHORTEST <= width <= _LONGEST else None


@dataclass(frozen=True)
class ModeAck:
    """The autopilot took the mode command or not, for the log. result: MAV_RESULT. The heartbeat counts."""

    accepted: bool
    result: int


SetRequest = ParameterRequest | WordsRequest | ResetRequest
InboundEvent = VehicleHeard | AnswerRequest | SetRequest | PolicyRequest | Pulses | ModeAck | ScriptHold
