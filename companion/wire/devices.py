"""Opens serial ports and configures TCP sockets, for the companion and the ground side."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
import threading
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


_SIOCOUTQNSD = 0x894B
"""Linux's request for the bytes of a TCP socket that were not sent once."""


def unconfirmed_bytes(fileno: int) -> int:
    """Return how many bytes a serial port's kernel has not sent, or a TCP peer's has not confirmed.

    0 where the kernel cannot tell, as of a pseudo-terminal.
    """
    try:
        import termios
    except ImportError:
        return 0
    return _count(fileno, termios.TIOCOUTQ)  # the number of SIOCOUTQ, too


def unsent_bytes(fileno: int) -> int:
    """Return how many bytes of a TCP socket the kernel has not sent once; 0 where it cannot tell."""
    return _count(fileno, _SIOCOUTQNSD) if sys.platform == "linux" else 0


def _count(fileno: int, request: int) -> int:
    try:
        import fcntl

        return int.from_bytes(fcntl.ioctl(fileno, request, bytes(4)), sys.byteorder)
    except (ImportError, OSError):
        return 0


_closing: dict[str, threading.Thread] = {}
"""Serial ports that are being closed, by name. The kernel may wait 30 s for a device that takes nothing."""

_IN_USE = "{} is in use by another program: `fuser {}` finds it"
_REMEDIES = {
    errno.ENOENT: "{} is not there: plug it in, or find its name in /dev/serial/by-id",
    errno.EACCES: "{} may not be opened by this user: `sudo usermod -aG dialout USER`, then log in again",
    errno.EAGAIN: _IN_USE,
    errno.EBUSY: _IN_USE,
}


_CLOSES_WITHIN = 0.05
"""s that `SerialPort.close` waits for the kernel."""


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

    def discard_output(self) -> None:
        """Discard what was written and has not left yet, where the driver can do that."""
        _guarded(self._port.reset_output_buffer)

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        """Close the port. Never blocks: the kernel goes on sending what was written, for 30 s at most."""
        thread = threading.Thread(target=self._close, name="closing", daemon=True)
        _closing[str(self._port.name)] = thread
        thread.start()
        thread.join(_CLOSES_WITHIN)

    def _close(self) -> None:
        with contextlib.suppress(Exception):
            self._port.close()


def open_port(device: str, baud: int) -> SerialPort:
    """Open a serial port for exclusive use. Raises OSError only; its text says what to do."""
    import serial

    closing = _closing.get(device)
    if closing is not None and closing.is_alive():
        raise OSError(errno.EBUSY, f"{device} is still being closed: it takes nothing")
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
