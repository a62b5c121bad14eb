"""Messages as bytes. Native code reads whatever a camera sends: what the vision process says is only data.

A message is a length (u32, little endian) and a pickle. The supervisor's side reads dataclasses and enums of
the modules listed here, and numpy arrays, nothing else. Pixels, attention and features stay where they are.
"""

from __future__ import annotations

import copyreg
import importlib
import io
import pickle
import struct
from dataclasses import is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from anytraverse.assessment import Maps, Observation
from anytraverse.frame import Frame
from anytraverse.history import History
from anytraverse.preferences import Preferences
from companion.model import Model

LARGEST = 64 << 20
"""Bytes of one message: more than the largest picture that a camera may deliver needs."""
_LENGTH = struct.Struct("<I")
_DATA_MODULES = frozenset(
    {
        *(f"anytraverse.{name}" for name in ("answers", "assessment", "history", "judging", "memory")),
        *(f"anytraverse.{name}" for name in ("perception", "preferences", "regions", "roi")),
        "companion.cameras.newest",
        "companion.model",
        "companion.vision.messages",
    }
)
_ARRAYS = frozenset({"ndarray", "dtype", "scalar", "_frombuffer", "_reconstruct"})
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


class _Pickler(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        """What stays behind: pixels, attention and features."""
        if isinstance(value, Frame):
            height, width = (*value.image.shape, 1, 1)[:2]
            return frame_of_size, (value.id, value.captured_at, height, width)
        if isinstance(value, Maps):
            pooled = {name: one for name, one in vars(value).items() if name != "known"}
            pooled["attention"] = np.empty((0, *value.signed.shape), np.float32)
            return copyreg.__newobj__, (Maps,), pooled  # type: ignore[attr-defined]
        if isinstance(value, Observation):
            seen = {**vars(value), "features": None, "attended": None}
            return copyreg.__newobj__, (Observation,), seen  # type: ignore[attr-defined]
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if module.partition(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module, name)
        if (module, name) == (__name__, frame_of_size.__name__):
            return frame_of_size
        if module in _DATA_MODULES:
            found = getattr(importlib.import_module(module), name, None)
            if isinstance(found, type) and (is_dataclass(found) or issubclass(found, _DATA_CLASSES)):
                return found
        raise CodecError(f"{module}.{name} is no data")
