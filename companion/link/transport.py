"""Reads and writes bytes over UDP, TCP or a serial port, without blocking."""

from __future__ import annotations

import errno
import math
import os
import socket
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

from companion.config.link_settings import Address, LinkError
from companion.link.limits import LeaseTable
from companion.wire.devices import open_port, watch_peer

MAX_PEERS = 4
KEPT = 10.0
"""s without an accepted frame after which another address may take this one's place."""

Peer = tuple[str, int]
"""Address and port."""


class Peers:
    """Stores the addresses that a bound UDP socket sends to: the autopilot's and at most four others.

    Only addresses from which a frame was accepted are stored. The first address from which the autopilot was
    received stays its address while frames arrive from there. Another address that sends in the autopilot's
    name gets a free place only, and loses it to any other sender.
    """

    def __init__(self) -> None:
        self._autopilot: LeaseTable[Peer, None] = LeaseTable(1, KEPT)
        self._others: LeaseTable[Peer, None] = LeaseTable(MAX_PEERS, KEPT)

    def __iter__(self) -> Iterator[Peer]:
        return iter(dict.fromkeys((*self._autopilot, *self._others)))

    def note_accepted(self, peer: Peer, now: float, *, autopilot: bool) -> None:
        """Store `peer`, from which a frame was accepted; autopilot: our autopilot sent it."""
        # Minus infinity gives a second "autopilot" the lowest claim to its place.
        if not (autopilot and self._autopilot.renew(peer, None, now)):
            self._others.renew(peer, None, -math.inf if autopilot else now)


_CHUNK = 2048
"""Bytes of one read; a longer datagram is cut. A frame has at most 280."""
_MAX_PENDING = 2048
_MAX_SKIPPED = 512
"""Datagrams that one read skips, because they are empty or from another address, to reach those behind."""


class Transport(Protocol):
    """One open device. `read` and `write` raise OSError when it is broken and has to be opened again.

    datagrams: whether each `read` returns whole frames only.
    """

    datagrams: bool

    def read(self) -> bytes:
        """Return what arrived, at most a few KiB; b"" when there is nothing now."""

    def write(self, frame: bytes) -> bool:
        """Send all of `frame`; send nothing and return False when the device takes nothing now."""

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Report that a frame of the last read was accepted; autopilot: our autopilot sent it."""

    def fileno(self) -> int | None:
        """The file descriptor to select on; None where there is none."""

    def close(self) -> None:
        """Close the device."""


class Udp:
    """Exchanges datagrams: udpin is bound to a port and sends to `Peers`, udpout has one fixed peer."""

    datagrams = True

    def __init__(self, address: Address) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0)
        address_and_port = (address.place, address.number)
        self._fixed: Peer | None = address_and_port if address.scheme == "udpout" else None
        self._peers = Peers()
        self._newest_peer: Peer | None = None
        try:
            if self._fixed is None:
                self._socket.bind(address_and_port)
        except OSError:
            self._socket.close()
            raise

    @property
    def port(self) -> int:
        """The bound port."""
        return int(self._socket.getsockname()[1])

    def read(self) -> bytes:
        for _ in range(_MAX_SKIPPED):
            try:
                datagram, peer = self._socket.recvfrom(_CHUNK)
            except (BlockingIOError, ConnectionRefusedError, InterruptedError):
                break
            if datagram and self._fixed in (None, peer):
                self._newest_peer = peer
                return datagram
        return b""

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        if self._newest_peer is not None:
            self._peers.note_accepted(self._newest_peer, now, autopilot=autopilot)

    def write(self, frame: bytes) -> bool:
        if self._fixed is not None:
            self._send(frame, self._fixed)
            return True
        sent = [self._send(frame, peer) for peer in self._peers]
        return any(sent)

    def _send(self, frame: bytes, peer: Peer) -> bool:
        """Send `frame`; False on an error that may pass: no receiver yet, full buffer, network down."""
        try:
            self._socket.sendto(frame, peer)
        except OSError as error:
            # Such as for a broadcast address: this error never passes.
            if self._fixed is not None and isinstance(error, PermissionError):
                raise
            return False
        return True

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """Writes whole frames to a device that may take only a part of one: the rest waits here."""

    datagrams = False

    def __init__(self) -> None:
        self._pending = b""

    def _send(self, data: bytes) -> int:
        raise NotImplementedError

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Do nothing: a stream has one peer only."""

    def write(self, frame: bytes) -> bool:
        if self._pending:
            self._pending = self._pending[self._send(self._pending) :]
        if len(self._pending) + len(frame) > _MAX_PENDING:
            return False
        if not self._pending:
            frame = frame[self._send(frame) :]
        self._pending += frame
        return True


class Tcp(_Stream):
    """Connects to a TCP server. A vanished peer is noticed within 15 s, where the platform supports it."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.settimeout(0)
        watch_peer(self._socket)
        code = self._socket.connect_ex((address.place, address.number))
        if code not in (0, errno.EINPROGRESS):
            self._socket.close()
            raise OSError(code, os.strerror(code))

    def read(self) -> bytes:
        code = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            raise OSError(code, os.strerror(code))
        try:
            data = self._socket.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            if error.errno == errno.ENOTCONN:  # still connecting
                return b""
            raise
        if not data:
            raise OSError(errno.ECONNRESET, "closed by the other end")
        return data

    def _send(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            if error.errno in (errno.ENOTCONN, errno.EPIPE) and not self._connected():
                return 0
            raise

    def _connected(self) -> bool:
        try:
            self._socket.getpeername()
        except OSError:
            return False
        return True

    def write(self, frame: bytes) -> bool:
        return self._connected() and super().write(frame)

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()


class Serial(_Stream):
    """Exchanges bytes over a serial port, which pyserial opens."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._port = open_port(address.place, address.number)

    def read(self) -> bytes:
        return self._port.read(_CHUNK)

    def _send(self, data: bytes) -> int:
        try:
            return self._port.write(data)
        except BlockingIOError:
            return 0

    def fileno(self) -> int | None:
        return self._port.fileno()

    def close(self) -> None:
        self._port.close()


def opener(address: Address) -> Callable[[], Transport]:
    """Return a function that opens `address`. Raises LinkError when `address` needs a missing library."""
    check_installed(address)
    return partial(open_transport, address)


def open_transport(address: Address) -> Transport:
    """Open the device at `address`. Raises OSError while it is absent."""
    if address.scheme == "tcp":
        return Tcp(address)
    if address.scheme == "serial":
        return Serial(address)
    return Udp(address)


def check_installed(address: Address) -> None:
    """Raise LinkError when `address` needs a library that is not installed."""
    if address.scheme == "serial":
        try:
            import serial  # noqa: F401
        except ImportError as error:
            raise LinkError(
                "a serial link needs pyserial: pip install 'anytraverse-companion[rover]'"
            ) from error
