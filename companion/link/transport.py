"""Bytes in, bytes out, never blocking: UDP, TCP, serial."""

from __future__ import annotations

import errno
import math
import os
import socket
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

from companion.link.limits import LeaseTable
from companion.link.settings import Address, LinkError
from companion.wire.devices import open_port, watch_peer

MAX_PEERS = 4
KEPT = 10.0
"""s without a believed frame after which another may take an address's place."""

Peer = tuple[str, int]
"""Address and port."""


class Peers:
    """The autopilot's address, and at most four others: only those from which a frame was believed.

    The address from which the autopilot was heard first stays its own while it is still heard there. Another
    one that speaks in its name is answered where there is room, and makes room for anybody else.
    """

    def __init__(self) -> None:
        self._autopilot: LeaseTable[Peer, None] = LeaseTable(1, KEPT)
        self._others: LeaseTable[Peer, None] = LeaseTable(MAX_PEERS, KEPT)

    def __iter__(self) -> Iterator[Peer]:
        return iter(dict.fromkeys((*self._autopilot, *self._others)))

    def believe(self, peer: Peer, now: float, *, autopilot: bool) -> None:
        """A frame from `peer` was believed; autopilot: it was our autopilot's."""
        if not (autopilot and self._autopilot.renew(peer, None, now)):
            self._others.renew(peer, None, -math.inf if autopilot else now)


_CHUNK = 2048
"""Bytes of one read; a datagram is cut to as many. A frame has 280 at most."""
_MAX_PENDING = 2048
_MAX_SKIPPED = 512
"""Datagrams that say nothing, or come from elsewhere: they must not keep back what waits behind them."""


class Transport(Protocol):
    """One open device. `read` and `write` raise OSError when it is broken and has to be opened again.

    datagrams: what `read` returns holds whole frames only.
    """

    datagrams: bool

    def read(self) -> bytes:
        """What arrived, at most a few KiB; b"" when there is nothing now."""

    def write(self, frame: bytes) -> bool:
        """Send all of `frame`, or nothing and return False when the device takes nothing now."""

    def believe(self, now: float, *, autopilot: bool) -> None:
        """A frame in what was read last was believed; autopilot: it was our autopilot's."""

    def fileno(self) -> int | None:
        """For select; None where there is none."""

    def close(self) -> None:
        """Give the device back."""


class Udp:
    """udpin: bound, answers whoever was believed (`Peers`). udpout: sends to one address, hears only it."""

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

    def believe(self, now: float, *, autopilot: bool) -> None:
        if self._newest_peer is not None:
            self._peers.believe(self._newest_peer, now, autopilot=autopilot)

    def write(self, frame: bytes) -> bool:
        if self._fixed is not None:
            self._send(frame, self._fixed)
            return True
        sent = [self._send(frame, peer) for peer in self._peers]
        return any(sent)

    def _send(self, frame: bytes, peer: Peer) -> bool:
        """Nobody there yet, a full buffer, a network that is down: the next frame tries again."""
        try:
            self._socket.sendto(frame, peer)
        except OSError as error:
            if self._fixed is not None and isinstance(error, PermissionError):  # as to a broadcast address
                raise
            return False
        return True

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """Whole frames into a device that may take only a part of one."""

    datagrams = False

    def __init__(self) -> None:
        self._pending = b""

    def _send(self, data: bytes) -> int:
        raise NotImplementedError

    def believe(self, now: float, *, autopilot: bool) -> None:
        """There is one other end only."""

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
    """A TCP client. A peer that went without a word is noticed within 15 s, where the platform can."""

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
            if error.errno == errno.ENOTCONN:
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
    """A serial port, opened by pyserial."""

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
    """Opens `address` each time that it is called. Raises LinkError where a library is missing for it."""
    check_installed(address)
    return partial(open_transport, address)


def open_transport(address: Address) -> Transport:
    """Open what the url names. Raises OSError while it is absent."""
    if address.scheme == "tcp":
        return Tcp(address)
    if address.scheme == "serial":
        return Serial(address)
    return Udp(address)


def check_installed(address: Address) -> None:
    """Raises LinkError when the url needs a library that is not installed."""
    if address.scheme == "serial":
        try:
            import serial  # noqa: F401
        except ImportError as error:
            raise LinkError(
                "a serial link needs pyserial: pip install 'anytraverse-companion[rover]'"
            ) from error
