"""Reads cameras of the kernel, such as USB cameras: `v4l2:/dev/v4l/by-id/...` or `v4l2:0`."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, NoFrameYet
from companion.cameras.late_frames import CAME_LATE, LateFrames
from companion.cameras.pixel_formats import MJPEG, PIXEL_FORMATS

_MANUAL = 1
_EXPOSURE_UNIT = 1e-4
_OLDEST = 10.0
"""Seconds of age up to which a time stamp is believed to be of the monotonic clock."""
_AHEAD = 0.05
"""Seconds by which the kernel's estimate of the capture time may be too late."""
_QUERYCAP, _ENUM_FMT, _ENUM_FRAMESIZES = 0x80685600, 0xC0405602, 0xC02C564A
_CAPABILITIES = struct.Struct("<16s32s32s3I12x")
_FORMAT = struct.Struct("<3I32s2I12x")
_SIZE = struct.Struct("<11I")
_CAPTURE = 0x1 | 0x1000  # V4L2_CAP_VIDEO_CAPTURE, and the same of several planes
_HAS_DEVICE_CAPS = 0x80000000
_PLAIN = 1
_MOST = 64
_NO_PICTURES = "delivers no pictures"


class V4l2Device:
    """Reads one device. `read` blocks for up to T, rounded up to whole seconds, whatever `timeout` says."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        self._path = f"/dev/video{place}" if place.isdecimal() else os.path.expanduser(place)
        self._latency = options.latency
        self._timeout = max(1, math.ceil(options.freshness))
        self._late = LateFrames(options.freshness)
        # CAP_PROP_READ_TIMEOUT_MSEC would make the open fail. OpenCV reads this once, before the first wait.
        os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] = str(self._timeout)
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            query(self._path)
        except DeviceError as error:
            raise CameraError(str(error)) from error
        self._video = cv2.VideoCapture(self._path, cv2.CAP_V4L2)
        try:
            self._set(options)
        except CameraError:
            self.close()
            raise

    def read(self, timeout: float) -> Capture:  # noqa: ARG002
        began = time.monotonic()
        grabbed = self._video.grab()
        now = time.monotonic()
        if not grabbed and now - began < 0.9 * self._timeout:
            raise CameraError(f"{self._path} is gone, or failed: check its cable and its supply")
        if not grabbed:
            raise NoFrameYet(f"{self._path} sent no picture in {self._timeout} s: read again")
        stamp = self._video.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        from_sensor = now - _OLDEST < stamp < now + _AHEAD
        if self._late.is_late(now) and not from_sensor:
            raise BadFrame(CAME_LATE)
        ok, picture = self._video.retrieve()
        if not ok or picture is None or picture.size == 0:
            raise BadFrame(f"a picture of {self._path} cannot be decoded: try another pixel_format or cable")
        colour = cv2.COLOR_GRAY2RGB if picture.ndim == 2 else cv2.COLOR_BGR2RGB
        image = np.asarray(cv2.cvtColor(picture, colour), np.uint8)
        if from_sensor:
            return Capture(min(stamp, now), image, "sensor")
        return Capture(now - self._latency, image, "arrival")

    def close(self) -> None:
        self._video.release()

    def _set(self, options: CameraOptions) -> None:
        """Ask for the configured format. Raises CameraError when the camera is busy or gives another one."""
        video = self._video
        if not video.isOpened():
            raise CameraError(in_use(self._path))
        if options.pixel_format is not None:
            name = "MJPG" if options.pixel_format == MJPEG else PIXEL_FORMATS[options.pixel_format].fourcc
            video.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*name))
            given = int(video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1")
            if given != name:
                raise CameraError(f"{self._path} gives {given}, not {name}: choose another pixel_format")
        if options.width is not None and options.height is not None:
            video.set(cv2.CAP_PROP_FRAME_WIDTH, options.width)
            video.set(cv2.CAP_PROP_FRAME_HEIGHT, options.height)
            width = int(video.get(cv2.CAP_PROP_FRAME_WIDTH))
            height = int(video.get(cv2.CAP_PROP_FRAME_HEIGHT))
            if (width, height) != (options.width, options.height):
                asked = f"{options.width} x {options.height}"
                raise CameraError(f"{self._path} gives {width} x {height}, not {asked}: choose that")
        if options.fps is not None:
            video.set(cv2.CAP_PROP_FPS, options.fps)
        if options.exposure is not None:
            video.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
            if not video.set(cv2.CAP_PROP_EXPOSURE, round(options.exposure / _EXPOSURE_UNIT)):
                raise CameraError(f"{self._path} has no exposure time to set: leave [camera] exposure out")


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
