"""Defines the events that the link reports to the daemon."""

from __future__ import annotations

from dataclasses import dataclass

from companion.calls.mode_monitor import ModeAnswer
from companion.guide.rules import GuideAnswer
from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.state import Vehicle
from companion.wire.answers import Answer
from companion.wire.ids import Policy, SenderId

_SHORTEST, _LONGEST = 800, 2200
"""us. MAVLink's 0 and 65535 mean that a channel does not exist."""


@dataclass(frozen=True)
class VehicleUpdate:
    """The autopilot sent a heartbeat, mode, position or news of its mission."""

    vehicle: Vehicle


@dataclass(frozen=True)
class ParameterRequest:
    """A request to set a parameter to a value in its range. Reply with `Link.parameters.set_value`."""

    sender: SenderId
    name: str
    value: float


@dataclass(frozen=True)
class ResetRequest:
    """A request to reset all settings as configured. Reply with `Link.commands.acknowledge`. Idempotent."""

    sender: SenderId


@dataclass(frozen=True)
class PolicyRequest:
    """A command to set the policy. Reply with `Link.commands.acknowledge`. Idempotent."""

    sender: SenderId
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


InboundEvent = (
    VehicleUpdate
    | Answer
    | ParameterRequest
    | ResetRequest
    | PolicyRequest
    | RcChannels
    | ModeAnswer
    | GuideAnswer
    | ScriptHold
)
