"""Messages as bytes. Native code reads whatever a camera sends: what the vision process says is only data.

A message is a length (u32, little endian) and a pickle. The supervisor's side reads dataclasses and enums of
the modules listed here, and arrays of numbers, nothing else. Pixels, attention and features stay behind.
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
"""Bytes of one message: more than the largest picture that a camera may deliver needs."""
_LENGTH = struct.Struct("<I")
_DATA_MODULES = frozenset(
    {
        *(f"anytraverse.{name}" for name in ("answers", "assessment", "history", "judging", "memory")),
        *(f"anytraverse.{name}" for name in ("perception", "preferences", "regions", "roi")),
        "companion.cameras.newest",
        "companion.vision.messages",
    }
)
_KINDS = {"<f4": np.float32, "|b1": np.bool_, "<i8": np.int64}
_DATA_CLASSES = (Enum, History, Model, Preferences)


class CodecError(Exception):
    """Bytes that are no message."""


class Splitter:
    """Cuts a stream of bytes into messages."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that are complete now, without their lengths. Raises CodecError for one too long."""
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


def encode(message: object) -> bytes:
    """The message with its length. Raises CodecError for one that is too long."""
    packed = io.BytesIO()
    packed.write(b"\0" * _LENGTH.size)
    _Pickler(packed, protocol=5).dump(message)
    length = packed.tell() - _LENGTH.size
    if length > LARGEST:
        raise CodecError(f"a message of {length} bytes, at most {LARGEST} are sent")
    packed.seek(0)
    packed.write(_LENGTH.pack(length))
    return packed.getvalue()


def decode(packed: bytes) -> Any:
    """A message of the vision process, its values unchecked. Raises CodecError for what is none."""
    try:
        return _Unpickler(io.BytesIO(packed)).load()
    except CodecError:
        raise
    except Exception as error:  # a torn pickle may raise anything
        raise CodecError(f"unreadable: {error!r}") from error


def decode_trusted(packed: bytes) -> Any:
    """A message of the supervisor, which the vision process trusts."""
    return pickle.loads(packed)


def frame_of_size(number: int, captured_at: float, height: int, width: int) -> Frame:
    """A frame of which only the size is known: its picture is black and takes no memory."""
    if not (0 < height <= 1 << 16 and 0 < width <= 1 << 16):
        raise CodecError(f"a picture of {width} x {height} pixels")
    return Frame(number, captured_at, np.broadcast_to(np.zeros((1, 1, 3), np.uint8), (height, width, 3)))


def made(module: str, name: str, content: Any) -> Any:
    """A value of a data class: an enum's member, or one with these fields."""
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
    value = object.__new__(kind)
    vars(value).update({str(field): one for field, one in content.items()})
    return value


def array_of(kind: str, shape: tuple[int, ...], content: bytes) -> Any:
    """An array of numbers or truth values."""
    return np.frombuffer(content, _KINDS[kind]).reshape(shape)


def number_of(value: float) -> float:
    """What was one of numpy's."""
    return value


class _Pickler(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        """Arrays and data only, and what stays behind: pixels, attention and features."""
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
    pickle.EMPTY_DICT, pickle.STACK_GLOBAL, pickle.REDUCE, pickle.MEMOIZE, pickle.BINGET, pickle.LONG_BINGET,
)
# fmt: on
"""All that a message needs. Others set attributes of what they name, or take gigabytes in nine bytes."""
_Plain: Any = vars(pickle)["_Unpickler"]


class _Unpickler(_Plain):  # type: ignore[misc]
    """The one in Python: the one in C cannot be kept from an opcode."""

    dispatch: ClassVar[dict[int, Any]] = {code[0]: _Plain.dispatch[code[0]] for code in _OPCODES}

    def _set_items(self) -> None:
        """Only texts are keys: to hash what is nested in itself may take for ever."""
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
        """Never a class: a pickle may do more with one than make it."""
        make = _MAKERS.get(name) if module == __name__ else None
        if make is None:
            raise CodecError(f"{module}.{name} is no data")
        return make


_MAKERS = {one.__name__: one for one in (made, array_of, number_of, frame_of_size)}
