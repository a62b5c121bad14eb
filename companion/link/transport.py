"""Reads and writes bytes over UDP, without blocking, and opens TCP and serial ports (`streams`), too."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

from anytraverse.release import to_install
from companion.config.link_settings import Address, LinkSettingError
from companion.link.limits import LeaseTable
from companion.link.streams import CHUNK, Serial, Tcp

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


_MAX_SKIPPED = 512
"""Datagrams that one read skips, because they are empty or from another address, to reach those behind."""


class Transport(Protocol):
    """One open device. `read` and `write` raise OSError when it is broken and has to be opened again.

    datagrams: whether each `read` returns whole frames only. rate: B/s that a line carries, infinite where
    that is not known.
    """

    datagrams: bool
    rate: float

    def read(self) -> bytes:
        """Return what arrived, at most a few KiB; b"" when there is nothing now."""

    def write(self, frame: bytes) -> bool:
        """Send all of `frame`; send nothing and return False when the device takes nothing now."""

    def check(self, now: float) -> None:
        """Raise OSError when the device has taken nothing for 1 s although something waits for it."""

    def idle(self) -> bool:
        """Whether nothing that was written waits in this computer, as far as that is known."""

    def note_revocable(self) -> None:
        """Let `settled` and `recall` be about what was written so far: its end may not leave late."""

    def settled(self) -> bool:
        """Whether that has left for certain: the device would tell what waits in it."""

    def has_room(self) -> bool:
        """Whether a frame may be written that an urgent one behind it would have to wait for."""

    def recall(self) -> None:
        """Drop what waits, unless `settled`. Raises OSError where only closing does that."""

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Report that a frame of the last read was accepted; autopilot: our autopilot sent it."""

    def fileno(self) -> int | None:
        """The file descriptor to select on; None where there is none."""

    def close(self) -> None:
        """Close the device."""


class Datagrams:
    """Answers for a transport of datagrams, of which none waits in the device."""

    datagrams = True
    rate = math.inf

    def check(self, now: float) -> None:
        """Do nothing: a datagram leaves at once or is lost, and so in the five methods below."""

    def idle(self) -> bool:
        return True

    def note_revocable(self) -> None:
        pass

    def settled(self) -> bool:
        return True

    def has_room(self) -> bool:
        return True

    def recall(self) -> None:
        pass


class Udp(Datagrams):
    """Exchanges datagrams: udpin is bound to a port and sends to `Peers`, udpout has one fixed peer."""

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
                datagram, peer = self._socket.recvfrom(CHUNK)
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


def opener(address: Address) -> Callable[[], Transport]:
    """Return a function that opens `address`. Raises LinkSettingError when that needs a missing library."""
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
    """Raise LinkSettingError when `address` needs a library that is not installed."""
    if address.scheme == "serial":
        try:
            import serial  # noqa: F401
        except ImportError as error:
            raise LinkSettingError(f"a serial link needs pyserial: {to_install('rover')}") from error
