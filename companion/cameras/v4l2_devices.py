"""Asks the kernel which cameras there are and what they can do, by V4L2's ioctls."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_QUERYCAP, _ENUM_FMT, _ENUM_FRAMESIZES = 0x80685600, 0xC0405602, 0xC02C564A
_CAPABILITIES = struct.Struct("<16s32s32s3I12x")
_FORMAT = struct.Struct("<3I32s2I12x")
_SIZE = struct.Struct("<11I")
_CAPTURE = 0x1 | 0x1000  # V4L2_CAP_VIDEO_CAPTURE, and the same of several planes
_HAS_DEVICE_CAPS = 0x80000000
_PLAIN = 1
_MOST = 64
_NO_PICTURES = "delivers no pictures"


class DeviceError(Exception):
    """The device cannot be used. The text says what to do."""


class Device(NamedTuple):
    """Describes a camera.

    path: to write after "v4l2:". name: of the product. formats: FOURCC -> sizes, (width, height) in pixels.
    """

    path: str
    name: str
    formats: dict[str, list[tuple[int, int]]]


def query(path: str) -> Device:
    """Ask a device what it is. Raises DeviceError when it is absent, forbidden, busy or no camera."""
    if not os.path.exists(path):
        raise DeviceError(f"{path} is not there: plug it in, or choose one that `companion cameras` lists")
    try:
        handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        raise DeviceError(_why(path, error)) from error
    try:
        _, card, _, _, every, own = _CAPABILITIES.unpack(_ask(handle, _QUERYCAP, bytes(_CAPABILITIES.size)))
        if not (own if every & _HAS_DEVICE_CAPS else every) & _CAPTURE:
            raise DeviceError(f"{path} {_NO_PICTURES}: take this camera's device that ends in 0")
        kind = 1 if (own if every & _HAS_DEVICE_CAPS else every) & 0x1 else 9
        return Device(path, card.split(b"\0")[0].decode(errors="replace"), dict(_formats(handle, kind)))
    except OSError as error:
        raise DeviceError(
            f"{path} is no camera ({error.strerror}): `companion cameras` lists them"
        ) from error
    finally:
        os.close(handle)


def devices() -> Iterator[Device | DeviceError]:
    """Yield each camera once, by the name that stays the same; or why one cannot be asked."""
    seen = set[str]()
    for folder, pattern in (("/dev/v4l/by-id", "*"), ("/dev/v4l/by-path", "*"), ("/dev", "video*")):
        for path in sorted(Path(folder).glob(pattern)):
            real = os.path.realpath(path)
            if real in seen:
                continue
            seen.add(real)
            try:
                yield query(str(path))
            except DeviceError as error:
                if _NO_PICTURES not in str(error):  # a camera has such devices beside its first
                    yield error


def _why(path: str, error: OSError) -> str:
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"{path} may not be opened: sudo usermod -aG video USER, then log in again"
    if error.errno == errno.EBUSY:
        return in_use(path)
    return f"{path} cannot be opened ({error.strerror}): unplug it and plug it in again"


def in_use(path: str) -> str:
    """Say that another program has the device."""
    return f"{path} is in use: end the other program; `sudo fuser -v {path}` names it"


def _ask(handle: int, code: int, packed: bytes) -> bytes:
    return fcntl.ioctl(handle, code, packed)


def _formats(handle: int, kind: int) -> Iterator[tuple[str, list[tuple[int, int]]]]:
    for index in range(_MOST):
        with contextlib.suppress(OSError):
            packed = _ask(handle, _ENUM_FMT, _FORMAT.pack(index, kind, 0, b"", 0, 0))
            code = _FORMAT.unpack(packed)[4]
            yield struct.pack("<I", code).decode("latin-1").strip(), list(_sizes(handle, code))
            continue
        return


def _sizes(handle: int, code: int) -> Iterator[tuple[int, int]]:
    for index in range(_MOST):
        try:
            answer = _SIZE.unpack(_ask(handle, _ENUM_FRAMESIZES, _SIZE.pack(index, code, *[0] * 9)))
        except OSError:
            return
        if answer[2] != _PLAIN:  # steps from a least to a greatest size
            yield answer[4], answer[7]
            return
        yield answer[3], answer[4]
