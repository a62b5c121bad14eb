"""Packs and unpacks the operator's answer (TUNNEL 45003) and its acknowledgement (45004)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, Tap
from companion.wire import layouts
from companion.wire.ids import VERSION, Motion, Outcome, Reasons, Result, SenderId, Stage
from companion.wire.packing import (
    Fractions,
    PayloadError,
    Reader,
    box_to_u16,
    fraction_to_u16,
    i16_to_signed,
    shortened,
    signed_to_i16,
    text_to_bytes,
    u16_to_box,
    u16_to_fraction,
)
from companion.wire.payloads import check_version

MAX_PAYLOAD = 128
MAX_WORD_BYTES = 96
_CODE = struct.Struct("<B")


class _Code(IntEnum):
    SET = 1
    TAP = 2
    FORGET_WORD = 3
    FORGET_CALL = 4
    NEW_EPISODE = 5
    OTHER_PLACE = 6
    PACK_INCIDENT = 7
    CANCEL_INCIDENT = 8
    RECORDING = 9


@dataclass(frozen=True)
class PackIncident:
    """Have an incident file packed about the call or hold `id`; 0: about the last minute. It stands alone."""

    id: int = 0


@dataclass(frozen=True)
class CancelIncident:
    """Pack no more what `PackIncident` with this `id` asked for. It stands alone."""

    id: int = 0


class Wish(IntEnum):
    """What is to become of a recording: packed as an incident is, packed no more, or deleted."""

    PACK = 0
    CANCEL = 1
    DELETE = 2


@dataclass(frozen=True)
class RecordingWish:
    """Do this with the recording of that number. It stands alone."""

    number: int
    wish: Wish


FilesRequest = PackIncident | CancelIncident | RecordingWish
AnyOperation = Operation | FilesRequest


def _pack_operation(operation: AnyOperation) -> bytes:
    match operation:
        case SetWord(word, weight):
            return (
                _CODE.pack(_Code.SET)
                + layouts.SET.struct.pack(signed_to_i16(weight))
                + text_to_bytes(word, MAX_WORD_BYTES)
            )
        case Tap(frame_id, box, word, weight):
            sides = box_to_u16(box)
            _box(sides)
            tap = layouts.TAP.struct.pack(frame_id & 0xFFFFFFFF, *sides, signed_to_i16(weight))
            return _CODE.pack(_Code.TAP) + tap + text_to_bytes(word, MAX_WORD_BYTES)
        case ForgetWord(word):
            return _CODE.pack(_Code.FORGET_WORD) + text_to_bytes(word, MAX_WORD_BYTES)
        case ForgetCall(call_id):
            return _CODE.pack(_Code.FORGET_CALL) + layouts.FORGET_CALL.struct.pack(call_id)
        case NewEpisode():
            return _CODE.pack(_Code.NEW_EPISODE)
        case OtherPlace(call_id):
            return _CODE.pack(_Code.OTHER_PLACE) + layouts.OTHER_PLACE.struct.pack(call_id)
        case PackIncident(call_id):
            return _CODE.pack(_Code.PACK_INCIDENT) + layouts.PACK_INCIDENT.struct.pack(call_id)
        case CancelIncident(call_id):
            return _CODE.pack(_Code.CANCEL_INCIDENT) + layouts.CANCEL_INCIDENT.struct.pack(call_id)
        case RecordingWish(number, wish):
            return _CODE.pack(_Code.RECORDING) + layouts.RECORDING.struct.pack(number, wish)


def _weight(raw: int) -> float:
    weight = i16_to_signed(raw)
    if weight is None:
        raise PayloadError("a weight is missing")
    return weight


def _box(raw: tuple[int, int, int, int]) -> Fractions:
    box = u16_to_box(raw)
    if box is None:
        raise PayloadError("a tap has no box")
    return box


def _read_operation(reader: Reader) -> AnyOperation:
    (code,) = reader.take(_CODE)
    if code == _Code.SET:
        (raw,) = reader.take(layouts.SET.struct)
        return SetWord(reader.text(), _weight(raw))
    if code == _Code.TAP:
        frame_id, left, top, right, bottom, raw = reader.take(layouts.TAP.struct)
        return Tap(frame_id, _box((left, top, right, bottom)), reader.text(), _weight(raw))
    if code == _Code.FORGET_WORD:
        return ForgetWord(reader.text())
    if code == _Code.FORGET_CALL:
        (call_id,) = reader.take(layouts.FORGET_CALL.struct)
        return ForgetCall(call_id)
    if code == _Code.NEW_EPISODE:
        return NewEpisode()
    if code == _Code.OTHER_PLACE:
        (call_id,) = reader.take(layouts.OTHER_PLACE.struct)
        return OtherPlace(call_id)
    if code == _Code.PACK_INCIDENT:
        (call_id,) = reader.take(layouts.PACK_INCIDENT.struct)
        return PackIncident(call_id)
    if code == _Code.CANCEL_INCIDENT:
        (call_id,) = reader.take(layouts.CANCEL_INCIDENT.struct)
        return CancelIncident(call_id)
    if code == _Code.RECORDING:
        number, wish = reader.take(layouts.RECORDING.struct)
        if wish not in tuple(Wish):
            raise PayloadError(f"wish {wish} is unknown: update this end")
        return RecordingWish(number, Wish(wish))
    raise PayloadError(f"operation {code} is unknown: update this end")


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
    """An operator's answer, the same on the ground, where it is given, and on the rover.

    target: id of the call or hold, 0 for the current one. transaction: of `PAYLOADS`, chosen at random by the
    one who sends it, else 0; an answer is applied once for each.
    Only the rover sets the rest. sender, via: who sent it, and what it came by. confirmation: of `COMMANDS`,
    above 0 where its sender repeats it. name, raw: of a TEXT, which sets words without a call: the extended
    parameter and its value as received.
    """

    target: int
    motion: Motion
    operations: tuple[AnyOperation, ...] = ()
    transaction: int = 0
    sender: SenderId = (0, 0)
    via: Via = Via.TUNNEL
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
    def changes(self) -> tuple[Operation, ...]:
        """The operations that change words, examples or scenes: all but those about files."""
        return tuple(one for one in self.operations if not isinstance(one, FilesRequest))

    @property
    def about_files(self) -> bool:
        """Whether it is about files alone, which concerns no call and changes nothing of it."""
        return bool(self.operations) and not self.changes

    @property
    def refuses_match(self) -> bool:
        """Whether it says only that a match was not the same place, which concerns no call."""
        alone = self.motion is Motion.NONE and bool(self.operations)
        return alone and all(isinstance(one, OtherPlace) for one in self.operations)

    def pack(self, part: int = 0, parts: int = 1) -> bytes:
        """Pack into a payload's bytes, as part `part` (from 0) of `parts`.

        The operations of all parts count in order. Raises PayloadError above 128 bytes: send several parts;
        and for a tap whose box is nothing as it is sent.
        """
        head = layouts.ANSWER.struct.pack(
            VERSION, self.transaction, self.target, self.motion, part, parts, len(self.operations)
        )
        payload = head + b"".join(_pack_operation(operation) for operation in self.operations)
        if len(payload) > MAX_PAYLOAD:
            raise PayloadError(f"answer of {len(payload)} bytes: send it in several parts")
        return payload

    @classmethod
    def unpack(cls, payload: bytes) -> tuple[Answer, int, int]:
        """Unpack and check a payload: what is in it, which part it is, of how many. Raises PayloadError."""
        reader = Reader(payload)
        version, transaction, target, motion, part, parts, count = reader.take(layouts.ANSWER.struct)
        check_version(version)
        if transaction == 0 or part >= parts:
            raise PayloadError("transaction 0 or a part beyond the last")
        operations = tuple(_read_operation(reader) for _ in range(count))
        reader.end()
        try:
            return cls(target, Motion(motion), operations, transaction), part, parts
        except ValueError as error:
            raise PayloadError(str(error)) from error


@dataclass(frozen=True)
class Acknowledgement:
    """The result of an answer, after its frames were judged again.

    target: the id that it was applied to. stage, outcome: of that call or hold now.
    reasons: of the newest frame; roi_uncertainty, worst_tile: of the call's frame, all judged again.
    words: hash of all words in use. text: for a person, at most 90 bytes.
    """

    transaction: int
    target: int
    result: Result
    stage: Stage
    outcome: Outcome
    roi_uncertainty: float | None
    worst_tile: float | None
    reasons: Reasons
    words: int
    text: str

    @classmethod
    def without_figures(cls, transaction: int, target: int, result: Result, text: str) -> Acknowledgement:
        """Make an acknowledgement that says nothing of a call, of frames or of the words in use."""
        return cls(transaction, target, result, Stage.CLOSED, Outcome.NONE, None, None, Reasons.NONE, 0, text)

    def pack(self) -> bytes:
        """Pack into the payload's bytes."""
        return layouts.ACKNOWLEDGEMENT.struct.pack(
            VERSION,
            self.transaction,
            self.target,
            self.result,
            self.stage,
            self.outcome,
            fraction_to_u16(self.roi_uncertainty),
            fraction_to_u16(self.worst_tile),
            self.reasons,
            self.words,
        ) + text_to_bytes(shortened(self.text, 90), 90)

    @classmethod
    def unpack(cls, payload: bytes) -> Acknowledgement:
        """Unpack and check a payload. Raises PayloadError."""
        reader = Reader(payload)
        version, transaction, target, result, stage, outcome, mean, tile, reasons, words = reader.take(
            layouts.ACKNOWLEDGEMENT.struct
        )
        text = reader.text()
        reader.end()
        check_version(version)
        try:
            return cls(
                transaction,
                target,
                Result(result),
                Stage(stage),
                Outcome(outcome),
                u16_to_fraction(mean),
                u16_to_fraction(tile),
                Reasons(reasons),
                words,
                text,
            )
        except ValueError as error:
            raise PayloadError(str(error)) from error
