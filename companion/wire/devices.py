"""TCP and serial ports for either end, and what a person can do about one that does not open."""

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
"""ms that what was sent may go unconfirmed, connecting included, and s for a connection that is silent."""


def watch_peer(connection: socket.socket) -> None:
    """A peer that is gone breaks the connection within 15 s, where the platform can. Before connecting."""
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
    """A port of pyserial's that is open and waits for nothing. Raises OSError only."""

    def __init__(self, port: Any) -> None:
        self._port = port

    def read(self, size: int) -> bytes:
        """What has come, `size` bytes at most."""
        return bytes(_guarded(lambda: self._port.read(size)))

    def write(self, data: bytes) -> int:
        """How much it took; BlockingIOError while it is full: pyserial's own tries for ever then."""
        return os.write(self._port.fileno(), data)

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._port.close()


def open_port(device: str, baud: int) -> SerialPort:
    """Open a port, held for ourselves alone. Raises OSError only."""
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
    """Raises OSError only: pyserial lets ValueError, termios.error and TypeError out."""
    try:
        return call()
    except OSError:
        raise
    except Exception as error:
        raise OSError(errno.EIO, str(error)) from error
