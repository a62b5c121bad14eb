"""Reads the simulated field's camera over loopback TCP: `field:127.0.0.1:PORT`. Always the newest frame.

There is never a queue. The client sends one byte `NEXT` for each frame that it wants. The server answers with
its newest frame, once that is another one than this client got last. So a slow client gets fewer frames, not
older ones. A frame on the wire, little-endian: magic b"ATF1", id u32, capture time f64 (s, CLOCK_MONOTONIC),
width u16, height u16, then height x width x 3 bytes RGB.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.cameras import CameraError, CameraOptions, Capture, NoFrameYet
from companion.cameras.places import field_address

HEADER = struct.Struct("<4sIdHH")
MAGIC = b"ATF1"
NEXT = b"\x01"
MAX_PIXELS = 1920 * 1080
SEND_TIMEOUT = 2.0


class FieldCamera:
    """Delivers frames of the simulated field, with the capture times that the simulator set.

    The capture times are of this computer's monotonic clock, so the address must be a loopback address.
    """

    def __init__(self, place: str, _: CameraOptions) -> None:
        host, port = field_address(place)
        try:
            self._stream = FrameStream(host, port)
        except FrameError as error:
            raise CameraError(str(error)) from error

    def read(self, timeout: float) -> Capture:
        try:
            frame = self._stream.read(timeout)
        except FrameTimeout as error:
            raise NoFrameYet(str(error)) from error
        except FrameError as error:
            raise CameraError(str(error)) from error
        return Capture(frame.captured_at, frame.rgb, "sensor")

    def close(self) -> None:
        self._stream.close()


class FrameError(Exception):
    """No frame could be read. The message says why and what to do."""


class FrameTimeout(FrameError):  # noqa: N818
    """No new frame came within the time-out; read again."""


class CapturedFrame(NamedTuple):
    """One frame. captured_at: s of time.monotonic(). rgb: (height, width, 3) uint8."""

    id: int
    captured_at: float
    rgb: NDArray[np.uint8]


def decode_header(header: bytes, max_pixels: int = MAX_PIXELS) -> tuple[int, float, int, int]:
    """Decode a header into (id, captured_at, width, height).

    Raises FrameError for a wrong magic number, a capture time that is not finite, or too many pixels.
    """
    magic, number, captured_at, width, height = HEADER.unpack(header)
    if magic != MAGIC:
        raise FrameError(f"expected a frame, got {magic!r}: is this the frame server's address?")
    if not math.isfinite(captured_at):
        raise FrameError("a frame whose capture time is not finite is refused: connect again")
    if not 0 < width * height <= max_pixels:
        raise FrameError(
            f"a frame of {width} x {height} pixels is refused: ask the server for at most {max_pixels}"
        )
    return number, captured_at, width, height


class FrameStream:
    """Reads frames from a `FrameServer`. Not thread-safe.

    After any FrameError but FrameTimeout the stream is unusable: connect again.
    """

    def __init__(self, host: str, port: int, timeout: float = 5.0, *, max_pixels: int = MAX_PIXELS) -> None:
        """Connect. Raises FrameError when no server answers within `timeout` s."""
        self._max_pixels = max_pixels
        self._buffer = bytearray()
        self._asked = False
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout)
        except OSError as reason:
            raise FrameError(f"no frame server at {host}:{port} ({reason}): is it running?") from reason
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def __enter__(self) -> FrameStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def read(self, timeout: float = 2.0) -> CapturedFrame:
        """Return the newest frame that was not read before; wait up to `timeout` s for it.

        Raises FrameTimeout when no whole frame came in time; the next `read` continues with the bytes that
        did. Raises FrameError for invalid data, a picture that is too large, or a closed stream.
        """
        deadline = time.monotonic() + timeout
        if not self._asked:  # else the request before a FrameTimeout is still open
            self._ask()
        self._fill(HEADER.size, deadline)
        number, captured_at, width, height = decode_header(
            bytes(self._buffer[: HEADER.size]), self._max_pixels
        )
        size = HEADER.size + width * height * 3
        self._fill(size, deadline)
        rgb = np.frombuffer(bytes(self._buffer[HEADER.size : size]), np.uint8).reshape(height, width, 3)
        del self._buffer[:size]
        self._asked = False
        return CapturedFrame(number, captured_at, rgb)

    def _ask(self) -> None:
        try:
            self._socket.settimeout(SEND_TIMEOUT)
            self._socket.sendall(NEXT)
        except OSError as reason:
            raise FrameError(f"the frame server is gone ({reason}): connect again") from reason
        self._asked = True

    def _fill(self, size: int, deadline: float) -> None:
        while len(self._buffer) < size:
            left = deadline - time.monotonic()
            if left <= 0:
                raise FrameTimeout(
                    "no new frame in time: the camera may be frozen; read again or connect anew"
                )
            try:
                self._socket.settimeout(left)
                chunk = self._socket.recv(size - len(self._buffer))
            except TimeoutError:
                continue
            except OSError as reason:
                raise FrameError(f"the frame server is gone ({reason}): connect again") from reason
            if not chunk:
                raise FrameError("the frame server closed the stream: connect again")
            self._buffer += chunk
