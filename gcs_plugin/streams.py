"""Streams to a link, TCP and serial: opened without waiting, and again a second after they broke."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

from companion.wire.serial_port import open_port
from companion.wire.tcp import watch_peer

MAX_READ = 4096
MAX_UNSENT = 8192
REOPEN_S = 1.0


class Stream:
    """A stream that is opened by `opener`, and again a second after it broke."""

    def __init__(self, name: str, opener: Callable[[], Any]) -> None:
        self.name = name
        self.trouble = ""
        self._opener = opener
        self._stream: Any = None
        self._reopen_at = 0.0
        self._unsent = b""

    def fileno(self) -> int | None:
        return None if self._stream is None else int(self._stream.fileno())

    def read(self) -> bytes:
        if self._stream is None and not self._open():
            return b""
        try:
            waiting = self._stream.receive()
        except BlockingIOError:
            waiting = b""
        except OSError as error:
            self._break(error)
            return b""
        if waiting:
            self.trouble = ""
        self._flush()
        return bytes(waiting)

    def write(self, frame: bytes) -> None:
        if self._stream is not None and len(self._unsent) + len(frame) <= MAX_UNSENT:
            self._unsent += frame
            self._flush()

    def close(self) -> None:
        self._break()
        self._reopen_at = float("inf")

    def _open(self) -> bool:
        now = time.monotonic()
        if now < self._reopen_at:
            return False
        self._reopen_at = now + REOPEN_S
        try:
            self._stream = self._opener()
        except OSError as error:
            self.trouble = error.strerror or str(error)
            return False
        return True

    def _flush(self) -> None:
        if self._stream is None or not self._unsent:
            return
        try:
            self._unsent = self._unsent[self._stream.send(self._unsent) :]
        except BlockingIOError:
            return
        except OSError as error:
            self._break(error)

    def _break(self, error: OSError | None = None) -> None:
        self.trouble = (error.strerror or str(error)) if error is not None else ""
        if self._stream is not None:
            self._stream.close()
        self._stream = None
        self._unsent = b""


class Tcp:
    """A client's socket; it may still be connecting when this returns. A peer that is gone is noticed."""

    def __init__(self, family: int, address: Any) -> None:
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.settimeout(0)
        watch_peer(self._socket)
        self._socket.connect_ex(address)
        self.fileno = self._socket.fileno
        self.send = self._socket.send
        self.close = self._socket.close

    def receive(self) -> bytes:
        waiting = self._socket.recv(MAX_READ)
        if not waiting:
            raise ConnectionResetError("the other end closed the connection")
        return waiting


class Serial:
    """A serial device, held for ourselves alone."""

    def __init__(self, device: str, baud: int) -> None:
        self._port = open_port(device, baud)
        self.fileno = self._port.fileno
        self.send = self._port.write
        self.close = self._port.close

    def receive(self) -> bytes:
        return self._port.read(MAX_READ)
