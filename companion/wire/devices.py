"""Opens serial ports and configures TCP sockets, for the companion and the ground side."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Callable
from typing import Any

OPTIONS = {
    "TCP_NODELAY": 1,
    "TCP_USER_TIMEOUT": 10_000,
    "TCP_KEEPIDLE": 5,
    "TCP_KEEPINTVL": 2,
    "TCP_KEEPCNT": 3,
}
"""TCP options. TCP_USER_TIMEOUT, for connecting and for sent data without ACK, is in ms; the others in s."""


def watch_peer(connection: socket.socket) -> None:
    """Make a vanished peer break the connection within 15 s, where the platform can. Before connecting."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in OPTIONS.items():
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


_IN_USE = "{} is in use by another program: `fuser {}` finds it"
_REMEDIES = {
    errno.ENOENT: "{} is not there: plug it in, or find its name in /dev/serial/by-id",
    errno.EACCES: "{} may not be opened by this user: `sudo usermod -aG dialout USER`, then log in again",
    errno.EAGAIN: _IN_USE,
    errno.EBUSY: _IN_USE,
}


class SerialPort:
    """Reads and writes an open port of pyserial without blocking. Raises OSError only."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def read(self, size: int) -> bytes:
        """Return what arrived, at most `size` bytes."""
        return bytes(_guarded(lambda: self._port.read(size)))

    def write(self, data: bytes) -> int:
        """Write `data`; return how many bytes were taken. Raises BlockingIOError when the buffer is full."""
        # Not pyserial's own write: that tries for ever while the buffer is full.
        return os.write(self._port.fileno(), data)

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._port.close()


def open_port(device: str, baud: int) -> SerialPort:
    """Open a serial port for exclusive use. Raises OSError only; its text says what to do."""
    import serial

    try:
        port = _guarded(lambda: serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True))
    except OSError as error:
        why = _REMEDIES.get(error.errno or 0)
        if why is None:
            raise
        raise OSError(error.errno, why.format(device, device)) from error
    return SerialPort(port)


def _guarded(call: Callable[[], Any]) -> Any:
    """Call `call`; turn pyserial's ValueError, termios.error and TypeError into OSError."""
    try:
        return call()
    except OSError:
        raise
    except Exception as error:
        raise OSError(errno.EIO, str(error)) from error
