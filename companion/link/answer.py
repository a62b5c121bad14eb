"""Defines an operator's answer, whichever message it came by, and what it changes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from anytraverse.operations import Operation, OtherPlace
from companion.wire.answers import AnyOperation, IncidentRequest
from companion.wire.ids import Motion, SenderId


class Via(Enum):
    """What an answer came by. Its acknowledgement goes back by the message that belongs to it."""

    TUNNEL = "TUNNEL 45003"
    PAGE = "the rover's own page"
    """The payload of a TUNNEL 45003, which the web process hands over."""
    COMMAND = "COMMAND_LONG 31010"
    TRACK_POINT = "MAV_CMD_CAMERA_TRACK_POINT"
    TRACK_RECTANGLE = "MAV_CMD_CAMERA_TRACK_RECTANGLE"
    AT_ANSWER = "PARAM_SET AT_ANSWER"
    TEXT = "PARAM_EXT_SET"


PAYLOADS = frozenset({Via.TUNNEL, Via.PAGE})
"""These carry a transaction, by which a repetition is known."""
COMMANDS = frozenset({Via.COMMAND, Via.TRACK_POINT, Via.TRACK_RECTANGLE})
"""These carry a count of how often they were sent, and are acknowledged by COMMAND_ACK."""


@dataclass(frozen=True)
class Answer:
    """An operator's answer, complete and well-formed. Reply with `Link.acknowledge`.

    target: id of the call or hold, 0 for the current one. transaction: of `PAYLOADS`, else 0. confirmation:
    of `COMMANDS`, above 0 where its sender repeats it. name, raw: of a TEXT, which sets words without a call:
    the extended parameter and its value as received.
    """

    sender: SenderId
    via: Via
    target: int
    motion: Motion
    operations: tuple[AnyOperation, ...] = ()
    transaction: int = 0
    confirmation: int = 0
    name: str = ""
    raw: bytes = b""

    @property
    def key(self) -> tuple[Any, ...]:
        """Equal for an answer and its repetitions. It begins with whose answers are bounded together."""
        owner = self.sender, self.via
        if self.via in PAYLOADS:
            return owner, self.transaction
        return owner, self.target, self.motion, self.operations, self.name, self.raw

    @property
    def refuses_match(self) -> bool:
        """Whether it says only that a match was not the same place, which concerns no call."""
        alone = self.motion is Motion.NONE and bool(self.operations)
        return alone and all(isinstance(one, OtherPlace) for one in self.operations)


def algorithms(operations: Iterable[AnyOperation]) -> tuple[Operation, ...]:
    """Return the operations that concern the algorithm: all but those about incident files."""
    return tuple(one for one in operations if not isinstance(one, IncidentRequest))
