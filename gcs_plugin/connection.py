"""Byte pipes to a link. They never block, and open again by themselves when they break.

Sockets of our own, since pymavlink's connection helper sets environment variables that other users of
pymavlink in the same process go by.
"""

from __future__ import annotations

import socket
import time
from typing import Any, Protocol

from gcs_plugin.streams import Serial, Stream, Tcp

MAX_DATAGRAM = 4096
MAX_READS = 64
MAX_PEERS = 16
PEER_FORGOTTEN_S = 30.0
DEFAULT_BAUD = 57600
EXAMPLES = "udpin:0.0.0.0:14550, udpout:192.168.1.20:14550, tcp:127.0.0.1:5760 or serial:/dev/ttyUSB0:57600"


class LinkError(OSError):
    """A link that cannot be opened; the text says what to do."""


class Connection(Protocol):
    """One link; `name` is its address, with the port that was bound."""

    @property
    def name(self) -> str: ...

    @property
    def trouble(self) -> str:
        """Why it is down, until something is heard again; empty when nothing is known to be wrong."""

    def fileno(self) -> int | None:
        """To wait on; None while it is down."""

    def read(self) -> bytes:
        """What waits; empty when nothing does."""

    def write(self, frame: bytes) -> None:
        """Send one frame, or lose it, as a radio does."""

    def close(self) -> None:
        """For good."""


class Udp:
    """A UDP socket. With a `peer` it speaks to that one; without, to whoever spoke within 30 s."""

    trouble = ""

    def __init__(self, family: int, bind: Any = None, peer: Any = None) -> None:
        self._peer = peer
        self._heard: dict[Any, float] = {}
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        if bind is not None:
            try:
                self._socket.bind(bind)
            except OSError as error:
                self._socket.close()
                raise LinkError(
                    f"cannot listen on {bind[0]}:{bind[1]}: {error}. Is the port taken?"
                ) from error

    @property
    def name(self) -> str:
        """As given, but with the port that the system chose for port 0."""
        if self._peer is None:
            host, port = self._socket.getsockname()[:2]
            return f"udpin:{host}:{port}"
        return f"udpout:{self._peer[0]}:{self._peer[1]}"

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def read(self) -> bytes:
        waiting = []
        for _ in range(MAX_READS):
            datagram = self._receive()
            if datagram is None:
                break
            waiting.append(datagram)
        return b"".join(waiting)

    def write(self, frame: bytes) -> None:
        now = time.monotonic()
        self._heard = {peer: at for peer, at in self._heard.items() if now - at < PEER_FORGOTTEN_S}
        for peer in self._heard if self._peer is None else [self._peer]:
            self._send(frame, peer)

    def close(self) -> None:
        self._socket.close()

    def _receive(self) -> bytes | None:
        try:
            datagram, sender = self._socket.recvfrom(MAX_DATAGRAM)
        except BlockingIOError:
            return None
        except OSError:
            return b""
        if sender in self._heard or len(self._heard) < MAX_PEERS:
            self._heard[sender] = time.monotonic()
        return datagram

    def _send(self, frame: bytes, peer: Any) -> None:
        try:
            self._socket.sendto(frame, peer)
        except OSError:
            return


def open_connection(link: str) -> Connection:
    """Open `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT` or `serial:DEVICE[:BAUD]`.

    TCP and serial links may come up later. Raises LinkError.
    """
    kind, _, rest = link.partition(":")
    if kind == "serial" and rest:
        return _open_serial(link, rest)
    if kind == "udpin":
        family, address = _resolve(link, rest)
        return Udp(family, bind=address)
    if kind == "udpout":
        family, address = _resolve(link, rest)
        return Udp(family, peer=address)
    if kind == "tcp":
        _resolve(link, rest)
        return Stream(link, lambda: Tcp(*_resolve(link, rest)))
    raise LinkError(f'"{link}" is not a link: write it as {EXAMPLES}')


def _resolve(link: str, rest: str) -> tuple[int, Any]:
    host, _, port = rest.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 0xFFFF:
        raise LinkError(f'"{link}" is not a link: write it as {EXAMPLES}')
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(port))[0]
    except (OSError, ValueError) as error:
        raise LinkError(f"{host}: {error}. Is the name right?") from error
    return int(found[0]), found[4]


def _open_serial(link: str, rest: str) -> Connection:
    device, _, speed = rest.rpartition(":")
    if not device:
        device, speed = rest, str(DEFAULT_BAUD)
    if not speed.isascii() or not speed.isdigit():
        raise LinkError(f'"{speed}" is not a speed: write it as serial:/dev/ttyUSB0:57600')
    baud = int(speed)
    _need_pyserial()
    return Stream(link, lambda: Serial(device, baud))


def _need_pyserial() -> None:
    try:
        import serial  # noqa: F401
    except ImportError as error:
        raise LinkError(
            "a serial link needs pyserial: pip install 'anytraverse-companion[ground]'"
        ) from error
