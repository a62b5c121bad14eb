"""Encodes and decodes the messages between supervisor and vision process.

A message is a length (u32, little-endian) and a pickle. The vision process runs native code on whatever a
camera sends, so the supervisor does not trust its pickles: it decodes dataclasses and enums of the modules
listed here, and arrays of numbers, nothing else, and no more of them than it has time for. Pixels, attention
maps and features are left out.
"""

from __future__ import annotations

import importlib
import io
import pickle
import struct
from dataclasses import is_dataclass
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from anytraverse.assessment import Maps, Observation
from anytraverse.frame import Frame
from anytraverse.history import History
from anytraverse.preferences import Preferences
from companion.vision.messages import Model

LARGEST = 64 << 20
"""Bytes of one message, at most: more than the largest picture of a camera needs."""
MOST_OPCODES = 100_000
"""Opcodes of one report, at most: so many take about 0.1 s. A picture's or a map's content is one."""
_LENGTH = struct.Struct("<I")
_DATA_MODULES = frozenset(
    {
        *(f"anytraverse.{name}" for name in ("answers", "assessment", "history", "judging", "light")),
        *(f"anytraverse.{name}" for name in ("memory", "perception", "preferences", "regions", "roi")),
        "companion.cameras.newest",
        "companion.vision.messages",
    }
)
_KINDS = {"<f4": np.float32, "|b1": np.bool_, "<i8": np.int64}
_DATA_CLASSES = (Enum, History, Model, Preferences)


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


def encode(report: object) -> bytes:
    """Encode a message of the vision process, with its length prefix.

    Nothing in it refers to an earlier part: a few such references could stand for millions of values.
    Raises CodecError when it is longer than `LARGEST`.
    """
    return _encoded(report, references=False)


def encode_trusted(request: object) -> bytes:
    """Encode a message of the supervisor, with its length prefix. Raises CodecError like `encode`."""
    return _encoded(request, references=True)


def _encoded(message: object, *, references: bool) -> bytes:
    packed = io.BytesIO()
    packed.write(b"\0" * _LENGTH.size)
    pickler = _Pickler(packed, protocol=5)
    pickler.fast = not references
    pickler.dump(message)
    length = packed.tell() - _LENGTH.size
    if length > LARGEST:
        raise CodecError(f"a message of {length} bytes, at most {LARGEST} are sent")
    packed.seek(0)
    packed.write(_LENGTH.pack(length))
    return packed.getvalue()


def decode(packed: bytes) -> Any:
    """Decode a message of the vision process; `check_report` must check its values. Raises CodecError."""
    try:
        return _Unpickler(packed).load()
    except CodecError:
        raise
    except Exception as error:  # a damaged pickle may raise anything
        raise CodecError(f"unreadable: {error!r}") from error


def decode_trusted(packed: bytes) -> Any:
    """Decode a message of the supervisor, which the vision process trusts."""
    return pickle.loads(packed)


def frame_of_size(number: int, captured_at: float, height: int, width: int) -> Frame:
    """Make a frame of this size without its pixels: the image is black and takes no memory."""
    if not (0 < height <= 1 << 16 and 0 < width <= 1 << 16):
        raise CodecError(f"a picture of {width} x {height} pixels")
    return Frame(number, captured_at, np.broadcast_to(np.zeros((1, 1, 3), np.uint8), (height, width, 3)))


def made(module: str, name: str, content: Any) -> Any:
    """Make a value of a listed data class from its fields, or an enum's member from its value."""
    if module not in _DATA_MODULES:
        raise CodecError(f"{module}.{name} is no data")
    kind = getattr(importlib.import_module(module), name, None)
    if not (isinstance(kind, type) and (is_dataclass(kind) or issubclass(kind, _DATA_CLASSES))):
        raise CodecError(f"{module}.{name} is no data")
    if issubclass(kind, Enum):
        if not isinstance(content, (str, int)):
            raise CodecError(f"no value of {name}")
        return kind(content)
    if issubclass(kind, tuple):
        return kind(*content)
    # Neither __init__ nor __post_init__ runs, so that no field is trusted: `checks` examines the values.
    value = object.__new__(kind)
    vars(value).update({str(field): one for field, one in content.items()})
    return value


def array_of(kind: str, shape: tuple[int, ...], content: bytes) -> Any:
    """Make a read-only array. kind: "<f4", "|b1" or "<i8"."""
    return np.frombuffer(content, _KINDS[kind]).reshape(shape)


def number_of(value: float) -> float:
    """Return a number that was a numpy scalar."""
    return value


class _Pickler(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        """Reduce a value to a call of one of `_MAKERS`, without pixels, attention maps and features."""
        if isinstance(value, Frame):
            height, width = (*value.image.shape, 1, 1)[:2]
            return frame_of_size, (value.id, value.captured_at, height, width)
        if isinstance(value, np.ndarray) and value.dtype.str in _KINDS:
            return array_of, (value.dtype.str, value.shape, value.tobytes())
        if isinstance(value, (np.number, np.bool_)):
            return number_of, (value.item(),)
        kind = type(value)
        if kind.__module__ not in _DATA_MODULES:
            return NotImplemented
        if isinstance(value, Enum):
            content: Any = value.value
        elif isinstance(value, tuple):
            content = tuple(value)
        elif isinstance(value, Maps):
            content = {**vars(value), "attention": np.empty((0, *value.signed.shape), np.float32)}
        elif isinstance(value, Observation):
            content = {**vars(value), "features": None, "attended": {}}
        elif isinstance(value, type):
            return NotImplemented
        else:
            content = dict(vars(value))
        return made, (kind.__module__, kind.__qualname__, content)


# fmt: off
_OPCODES = (
    pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE,
    pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT, pickle.SHORT_BINUNICODE,
    pickle.BINUNICODE, pickle.SHORT_BINBYTES, pickle.BINBYTES, pickle.EMPTY_TUPLE, pickle.TUPLE1,
    pickle.TUPLE2, pickle.TUPLE3, pickle.TUPLE, pickle.EMPTY_LIST, pickle.APPEND, pickle.APPENDS,
    pickle.EMPTY_DICT, pickle.STACK_GLOBAL, pickle.REDUCE,
)
# fmt: on
"""All opcodes that a message needs. The others set attributes of any object that they name, allocate
gigabytes from nine bytes, or repeat what came before."""
_Plain: Any = vars(pickle)["_Unpickler"]


class _Counted(dict[int, Any]):
    """What carries out each opcode, of which so many are left."""

    left = MOST_OPCODES

    def __getitem__(self, code: int) -> Any:
        self.left -= 1
        if self.left < 0:
            raise CodecError(f"more than {MOST_OPCODES} opcodes")
        return super().__getitem__(code)


class _Unpickler(_Plain):  # type: ignore[misc]
    """Decodes only `_OPCODES`. It is Python's unpickler, because in C's no opcode can be forbidden."""

    dispatch: ClassVar[dict[int, Any]] = {code[0]: _Plain.dispatch[code[0]] for code in _OPCODES}

    def __init__(self, packed: bytes) -> None:
        super().__init__(io.BytesIO(packed))
        self.dispatch = _Counted(self.dispatch)  # type: ignore[misc]

    def _set_items(self) -> None:
        """Set items whose keys are str: hashing a key that is nested in itself may never end."""
        items = self.pop_mark()
        if len(items) % 2 or not all(isinstance(key, str) for key in items[::2]):
            raise CodecError("a key that is no text")
        self.stack[-1].update(zip(items[::2], items[1::2], strict=True))

    def _set_item(self) -> None:
        key, value = self.stack[-2:]
        del self.stack[-2:]
        if not isinstance(key, str):
            raise CodecError("a key that is no text")
        self.stack[-1].update({key: value})

    dispatch[pickle.SETITEMS[0]] = _set_items
    dispatch[pickle.SETITEM[0]] = _set_item

    def find_class(self, module: str, name: str) -> Any:
        """Return one of `_MAKERS`, never a class: a pickle may call a class in other ways."""
        make = _MAKERS.get(name) if module == __name__ else None
        if make is None:
            raise CodecError(f"{module}.{name} is no data")
        return make


_MAKERS = {one.__name__: one for one in (made, array_of, number_of, frame_of_size)}
