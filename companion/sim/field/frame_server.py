"""Serves pictures over loopback TCP: the other end of `FrameStream`."""

from __future__ import annotations

import contextlib
import socket
import threading

import numpy as np

from companion.cameras.field import HEADER, MAGIC, NEXT, SEND_TIMEOUT, CapturedFrame

MAX_CLIENTS = 4
POLL = 0.2


def encode(frame: CapturedFrame) -> bytes:
    """Encode a frame for the wire. Raises ValueError when `rgb` is not (height, width, 3) uint8."""
    if frame.rgb.ndim != 3 or frame.rgb.shape[2] != 3 or frame.rgb.dtype != np.uint8:
        raise ValueError(f"a frame is (height, width, 3) uint8, not {frame.rgb.shape} {frame.rgb.dtype}")
    height, width, _ = frame.rgb.shape
    header = HEADER.pack(MAGIC, frame.id & 0xFFFFFFFF, frame.captured_at, width, height)
    return header + np.ascontiguousarray(frame.rgb).tobytes()


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
