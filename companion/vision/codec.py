"""Encodes and decodes the messages between supervisor and vision process.

A message is a length (u32, little-endian) and a content. A request's is a pickle, since the vision process
trusts the supervisor. A report's is a MessagePack with its length (u32) before it, and behind it the content
of its arrays, in order. The vision process runs native code on whatever a camera sends, so the supervisor
does not trust it: it decodes the types of the fields in `messages`, nothing else, and no more of them than it
has time for. Pixels, attention maps and features are left out.
"""

from __future__ import annotations

import gc
import math
import pickle
import struct
from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Raw, Struct, convert, msgpack, structs

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment
from anytraverse.history import History
from anytraverse.preferences import MAX_WORD_LENGTH, MAX_WORDS, Preferences, Setting
from anytraverse.regions import Box, Region
from companion.vision.messages import Done, Drawn, Encoded, FrameJudged, Logged, Report, Request
from companion.wire.packing import clean

LARGEST = 64 << 20
"""Bytes of one message, at most: more than the largest picture of a camera needs."""
LARGEST_PACK = 256 << 10
"""Bytes of a report's MessagePack, at most, but of one of pictures. So many take 0.04 s at most."""
MOST_ARRAYS = 4096
"""Arrays of one report, at most."""
_LENGTH = struct.Struct("<I")
_LARGEST_SIDE = 1 << 16
_LEAVES = frozenset({bool, int, float, str, bytes, type(None)})
_LONGEST_ERROR = 200
_Size = Annotated[int, Meta(ge=0, le=LARGEST)]
_Array = tuple[str, Annotated[tuple[_Size, ...], Meta(max_length=3)]]
"""Kind and shape of an array."""
_Word = Annotated[str, Meta(max_length=MAX_WORD_LENGTH)]
_Words = Annotated[dict[_Word, Setting], Meta(max_length=MAX_WORDS)]


class CodecError(Exception):
    """The bytes are not a message, or the message is too long."""


class Splitter:
    """Splits a stream of bytes into messages."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes, and return the messages that are complete now, without their length prefixes.

        Raises CodecError for a message longer than `LARGEST`.
        """
        self._waiting += data
        found = []
        while len(self._waiting) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._waiting)
            if length > LARGEST:
                raise CodecError(f"a message of {length} bytes, at most {LARGEST} are read")
            end = _LENGTH.size + length
            if len(self._waiting) < end:
                break
            found.append(bytes(self._waiting[_LENGTH.size : end]))
            del self._waiting[:end]
        return found


def encode(report: Report) -> bytes:
    """Encode a message of the vision process, with its length. Raises CodecError beyond `LARGEST`."""
    return _with_length(pack(_without_pixels(report)))


def encode_trusted(request: Request) -> bytes:
    """Encode a message of the supervisor, with its length. Raises CodecError like `encode`."""
    return _with_length(pickle.dumps(request, protocol=5))


def decode_trusted(packed: bytes) -> Request:
    """Decode a message of the supervisor, which the vision process trusts."""
    request: Request = pickle.loads(packed)
    return request


def _with_length(packed: bytes) -> bytes:
    if len(packed) > LARGEST:
        raise CodecError(f"a message of {len(packed)} bytes, at most {LARGEST} are sent")
    return _LENGTH.pack(len(packed)) + packed


def pack(report: object) -> bytes:
    """Pack a report with all that is in it, but for pixels."""
    contents: list[bytes] = []

    def packable(value: object) -> object:
        match value:
            case np.ndarray():
                contents.append(value.tobytes() if value.dtype != np.uint8 else b"")
                return value.dtype.str, value.shape
            case np.generic():
                return value.item()
            case Preferences():
                return value.settings
            case History():
                return value.limit
        raise TypeError(f"a {type(value).__name__} is no data")

    packed = msgpack.encode(report, enc_hook=packable)
    return b"".join([_LENGTH.pack(len(packed)), packed, *contents])


def decode(packed: bytes) -> Report:
    """Decode a message of the vision process; `check_report` must check its values. Raises CodecError."""
    gc.disable()  # else many small lists would take ten times as long
    try:
        (length,) = _LENGTH.unpack_from(packed)
        end = _LENGTH.size + length
        kinds: Any = Report if length <= LARGEST_PACK else Drawn | Encoded
        view = memoryview(packed)
        contents = _Contents(view[end:])
        report: Report = msgpack.decode(view[_LENGTH.size : end], type=kinds, dec_hook=contents.made)
        if contents.rest:
            raise CodecError("content of no array")
        if not isinstance(report, Logged):  # it has no parts, and its lines are cleaned where they are logged
            fields: Any = (
                list[Raw] if isinstance(report, Drawn | Encoded) else Any
            )  # no second copy of a picture
            _check_parts(report, msgpack.decode(view[_LENGTH.size : end], type=fields))
    except Exception as error:  # damaged bytes may raise anything
        raise CodecError(f"unreadable: {clean(str(error)[:_LONGEST_ERROR])}") from error
    finally:
        gc.enable()
    return report


def _check_parts(value: Any, told: Any) -> None:
    """Refuse a part of which a field was left out: msgspec takes the default, which is no evidence.

    So is a text refused that could control a terminal. told: what the part was made from.
    """
    parts: Iterable[tuple[Any, object]] = ()
    if isinstance(value, Struct):
        value, told = structs.astuple(value), told[1:]  # behind its kind
    elif (fields := getattr(value, "__dataclass_fields__", None)) is not None:
        if not fields.keys() <= told.keys():
            raise CodecError(f"a {type(value).__name__} without all fields")
        parts = vars(value).items()
    elif isinstance(value, dict):
        parts = [*value.items(), *zip(value, value, strict=True)]
    if isinstance(value, tuple):
        if len(value) != len(told):
            raise CodecError(f"{len(told)} of {len(value)} fields")
        parts = enumerate(value)
    for at, one in parts:
        if type(one) not in _LEAVES:
            _check_parts(one, told[at])
        elif type(one) is str and not one.isprintable():
            raise CodecError("a text that cannot be printed")


class _Contents:
    """Gives each array of a report its content: no byte is read twice, so a few cannot become many."""

    def __init__(self, contents: memoryview) -> None:
        self.rest = contents
        self._arrays_left = MOST_ARRAYS

    def made(self, kind: Any, value: Any) -> Any:
        """Make a value of a type that msgspec does not know."""
        if kind is Preferences:
            settings = convert(value, _Words)
            if any(one.order < 0 for one in settings.values()):
                raise CodecError("a word's stamp below 0")
            return Preferences(settings)
        if kind is History:
            return History((), convert(value, _Size))
        if kind is Region:
            return convert(value, Box)
        (number,) = kind.__args__[1].__args__  # of NDArray[number]
        return self._array(number, *convert(value, _Array))

    def _array(self, kind: type[np.generic], told: str, shape: tuple[int, ...]) -> Any:
        """Make a read-only array, or a black image that takes no memory."""
        dtype = np.dtype(kind)
        self._arrays_left -= 1
        if self._arrays_left < 0:
            raise CodecError(f"more than {MOST_ARRAYS} arrays")
        if told != dtype.str:
            raise CodecError(f"an array of {told!r}, not {dtype.str}")
        if kind is np.uint8:
            if len(shape) != 3 or shape[2] != 3 or not 0 < min(shape) <= max(shape) <= _LARGEST_SIDE:
                raise CodecError(f"a picture of {shape} pixels")
            return np.broadcast_to(np.zeros((1, 1, 3), np.uint8), shape)
        size = dtype.itemsize * math.prod(shape)
        content, self.rest = bytes(self.rest[:size]), self.rest[size:]
        array: Any = np.ndarray(shape, dtype, content)  # raises where the content is too short
        # A byte of a bool may be any number, and sums would count it.
        return array.view(np.uint8) != 0 if kind is np.bool_ else array


def _without_pixels(report: Report) -> Report:
    match report:
        case FrameJudged():
            return structs.replace(report, assessment=_figures(report.assessment))
        case Done(outcome=AnswerOutcome() as outcome):
            call = None if outcome.call is None else _figures(outcome.call)
            newest = None if outcome.newest is None else _figures(outcome.newest)
            return structs.replace(report, outcome=replace(outcome, call=call, newest=newest))
    return report


def _figures(seen: Assessment) -> Assessment:
    """Return an assessment without depth, attention maps and features."""
    frame = replace(seen.frame, depth=None, intrinsics=None)
    maps, observation = seen.maps, seen.observation
    if maps is not None:
        maps = replace(maps, attention=maps.attention[:0])
    if observation is not None:
        observation = replace(observation, frame=frame, features=None, attended={})
    return replace(seen, frame=frame, maps=maps, observation=observation)
