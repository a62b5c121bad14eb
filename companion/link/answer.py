"""Defines an operator's answer, whichever message it came by, and what it changes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from anytraverse.answers import Changes, Tap
from anytraverse.regions import Box
from companion.wire.answers import (
    ForgetCall,
    ForgetWord,
    NewEpisode,
    Operation,
    OtherPlace,
    SetWord,
    TapBox,
)
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
    operations: tuple[Operation, ...] = ()
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


def changes_of(operations: Iterable[Operation]) -> Changes:
    """Convert the operations of a payload to changes. Raises AnyTraverseError for an invalid box."""
    weights: dict[str, float] = {}
    taps: list[Tap] = []
    words: list[str] = []
    calls: list[int] = []
    new_episode, other_place = False, None
    for operation in operations:
        match operation:
            case SetWord(word, weight):
                weights[word] = weight
            case TapBox(frame_id, box, word, weight):
                taps.append(Tap(frame_id, Box(*box), word, weight))
            case ForgetWord(word):
                words.append(word)
            case ForgetCall(call_id):
                calls.append(call_id)
            case NewEpisode():
                new_episode = True
            case OtherPlace(call_id):
                other_place = call_id
    return Changes(weights, tuple(taps), tuple(words), tuple(calls), new_episode, other_place=other_place)
