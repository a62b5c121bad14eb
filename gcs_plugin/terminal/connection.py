"""Opens links as byte streams that never block. TCP and serial links reopen by themselves when they break."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any, Protocol

from anytraverse.release import to_install
from companion.wire.devices import open_port, watch_peer
from gcs_plugin.terminal.lookup import Address, Name

MAX_READ = 4096
MAX_UNSENT = 8192
REOPEN_S = 1.0


class ReopeningConnection:
    """Opens a stream with `opener`, and opens it again a second after it broke.

    opener: raises BlockingIOError while it has to wait for something; then it is called again.
    """

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
        except BlockingIOError as error:  # its name is being looked up
            self._reopen_at, self.trouble = now, error.strerror or self.trouble
            return False
        except (OSError, ValueError) as error:
            self.trouble = getattr(error, "strerror", None) or str(error)
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


class _TcpConnection:
    """Wraps a TCP client's socket, which may still be connecting; a lost peer becomes an OSError."""

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


class _SerialConnection:
    """Wraps a serial device, opened for exclusive use."""

    def __init__(self, device: str, baud: int) -> None:
        self._port = open_port(device, baud)
        self.fileno = self._port.fileno
        self.send = self._port.write
        self.close = self._port.close

    def receive(self) -> bytes:
        return self._port.read(MAX_READ)


MAX_DATAGRAM = 4096
MAX_READS = 64
MAX_PEERS = 16
PEER_FORGOTTEN_S = 30.0
DEFAULT_BAUD = 57600
EXAMPLES = "udpin:0.0.0.0:14550, udpout:192.168.1.20:14550, tcp:127.0.0.1:5760 or serial:/dev/ttyUSB0:57600"


class LinkError(OSError):
    """Reports a link that cannot be opened; the text says what to do."""


class OperatorConnection(Protocol):
    """Represents one link. `name` is its address, with the port that was bound."""

    @property
    def name(self) -> str: ...

    @property
    def trouble(self) -> str:
        """Why the link is down, until something is received again; "" when no problem is known."""

    def fileno(self) -> int | None:
        """Return the file descriptor to wait on; None while the link is down."""

    def read(self) -> bytes:
        """Return the bytes that were received, maybe none."""

    def write(self, frame: bytes) -> None:
        """Send one frame, or drop it without an error, as a radio would."""

    def close(self) -> None:
        """Close the link for good."""


class UdpConnection:
    """Wraps a UDP socket. It sends to `peer`, or without one to the 16 newest senders of the last 30 s."""

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
        """The address as given, but with the port that the system chose for port 0."""
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
        self._heard.pop(sender, None)
        self._heard[sender] = time.monotonic()
        if len(self._heard) > MAX_PEERS:
            del self._heard[next(iter(self._heard))]
        return datagram

    def _send(self, frame: bytes, peer: Any) -> None:
        try:
            self._socket.sendto(frame, peer)
        except OSError:
            return


def open_connection(link: str) -> OperatorConnection:
    """Open `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT` or `serial:DEVICE[:BAUD]`.

    TCP and serial links may connect later. Raises LinkError.
    """
    kind, _, rest = link.partition(":")
    if kind == "serial" and rest:
        return _open_serial(link, rest)
    if kind == "udpin":
        family, address = _first(_name(link, rest))
        return UdpConnection(family, bind=address)
    if kind == "udpout":
        family, address = _first(_name(link, rest))
        return UdpConnection(family, peer=address)
    if kind == "tcp":
        name = _name(link, rest)
        _first(name)
        return ReopeningConnection(link, lambda: _TcpConnection(*name.now()))
    raise LinkError(f'"{link}" is not a link: write it as {EXAMPLES}')


def _name(link: str, rest: str) -> Name:
    host, _, port = rest.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 0xFFFF:
        raise LinkError(f'"{link}" is not a link: write it as {EXAMPLES}')
    return Name(host.strip("[]"), int(port))


def _first(name: Name) -> Address:
    try:
        return name.first()
    except BlockingIOError as error:
        raise LinkError(f"{error.strerror}. Is there a network? Else give the address as a number") from error
    except (OSError, ValueError) as error:
        raise LinkError(f"{name.host}: {error}. Is the name right?") from error


def _open_serial(link: str, rest: str) -> OperatorConnection:
    device, _, speed = rest.rpartition(":")
    if not device:
        device, speed = rest, str(DEFAULT_BAUD)
    if not speed.isascii() or not speed.isdigit():
        raise LinkError(f'"{speed}" is not a speed: write it as serial:/dev/ttyUSB0:57600')
    baud = int(speed)
    _need_pyserial()
    return ReopeningConnection(link, lambda: _SerialConnection(device, baud))


def _need_pyserial() -> None:
    try:
        import serial  # noqa: F401
    except ImportError as error:
        raise LinkError(f"a serial link needs pyserial: {to_install('ground')}") from error
