"""Sends frames over loopback TCP, from a `FrameServer` to a `FrameStream`; always the newest, never a queue.

The client sends one byte `NEXT` for each frame that it wants. The server answers with its newest frame, once
that is another one than this client got last. So a slow client gets fewer frames, not older ones. A frame on
the wire, little-endian: magic b"ATF1", id u32, capture time f64 (s, CLOCK_MONOTONIC), width u16, height u16,
then height x width x 3 bytes RGB.
"""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import threading
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<4sIdHH")
MAGIC = b"ATF1"
NEXT = b"\x01"
MAX_PIXELS = 1920 * 1080
MAX_CLIENTS = 4
SEND_TIMEOUT = 2.0
POLL = 0.2


class FrameError(Exception):
    """No frame could be read. The message says why and what to do."""


class FrameTimeout(FrameError):  # noqa: N818
    """No new frame came within the time-out; read again."""


class CapturedFrame(NamedTuple):
    """One frame. captured_at: s of time.monotonic(). rgb: (height, width, 3) uint8."""

    id: int
    captured_at: float
    rgb: NDArray[np.uint8]


def encode(frame: CapturedFrame) -> bytes:
    """Encode a frame for the wire. Raises ValueError when `rgb` is not (height, width, 3) uint8."""
    if frame.rgb.ndim != 3 or frame.rgb.shape[2] != 3 or frame.rgb.dtype != np.uint8:
        raise ValueError(f"a frame is (height, width, 3) uint8, not {frame.rgb.shape} {frame.rgb.dtype}")
    height, width, _ = frame.rgb.shape
    header = HEADER.pack(MAGIC, frame.id & 0xFFFFFFFF, frame.captured_at, width, height)
    return header + np.ascontiguousarray(frame.rgb).tobytes()


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


class FrameServer:
    """Serves the newest published frame on 127.0.0.1, with one thread for each client."""

    def __init__(self, *, port: int = 0, max_clients: int = MAX_CLIENTS) -> None:
        """port: 0 for a free one; that of an earlier server to take its place."""
        self._published = threading.Condition()
        self._newest: tuple[int, bytes] | None = None
        self._closed = False
        self._free_clients = threading.BoundedSemaphore(max_clients)
        self._server_socket = socket.create_server(("127.0.0.1", port))
        self._server_socket.settimeout(POLL)
        self.address: tuple[str, int] = self._server_socket.getsockname()
        threading.Thread(target=self._accept, name="frames", daemon=True).start()

    def publish(self, frame: CapturedFrame) -> None:
        """Replace the newest frame. Never waits for a client."""
        packed = encode(frame)
        with self._published:
            self._newest = (frame.id, packed)
            self._published.notify_all()

    def close(self) -> None:
        with self._published:
            self._closed = True
            self._published.notify_all()
        self._server_socket.close()

    def _accept(self) -> None:
        while not self._closed:
            try:
                client, _ = self._server_socket.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            if not self._free_clients.acquire(blocking=False):
                client.close()
                continue
            threading.Thread(target=self._serve, args=(client,), name="frames-client", daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        last: int | None = None
        try:
            with contextlib.closing(client), contextlib.suppress(OSError):
                while self._is_asked(client):
                    frame = self._newer_than(last, client)
                    if frame is None:
                        return
                    last, packed = frame
                    client.settimeout(SEND_TIMEOUT)
                    client.sendall(packed)
        finally:
            self._free_clients.release()

    def _is_asked(self, client: socket.socket) -> bool:
        """Wait for a request. False when the client hung up or sent another byte, or the server closes."""
        client.settimeout(POLL)
        while not self._closed:
            with contextlib.suppress(TimeoutError):
                return client.recv(1) == NEXT
        return False

    def _newer_than(self, last: int | None, client: socket.socket) -> tuple[int, bytes] | None:
        """Wait for a frame other than `last`. None when the client hung up or the server closes."""
        with self._published:
            while not self._closed and not _hung_up(client):
                if self._newest is not None and self._newest[0] != last:
                    return self._newest
                self._published.wait(POLL)
        return None


def _hung_up(client: socket.socket) -> bool:
    client.settimeout(0.0)
    try:
        return client.recv(1, socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
