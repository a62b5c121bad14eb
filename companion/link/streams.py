"""Reads and writes bytes over TCP or a serial port, without blocking, and ends frames that were cut."""

from __future__ import annotations

import errno
import math
import os
import select
import socket
import struct

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import BITS_PER_BYTE, Address
from companion.wire.devices import open_port, unconfirmed_bytes, unsent_bytes, watch_peer

CHUNK = 2048
"""Bytes of one read; a longer datagram is cut. A frame has at most 280."""
STUCK_AFTER = 1.0
"""s in which a device takes nothing, after which it is opened again."""
ROOM = 0.1
"""s of a serial line that its kernel may hold before a frame that an urgent one would have to wait for."""
STUCK = "takes nothing: check its cable and flow control"
_LONGEST_FRAME = 280
FILLER = bytes(_LONGEST_FRAME - 1)
"""Zeros, no beginning of a frame. A parser that has begun a frame waits for the length that it claims."""


class StuckError(OSError):
    """Raised for a device that has taken nothing for 1 s."""


class Stream:
    """Writes whole frames to a device. Where it takes a part of a frame, the rest waits here.

    The other end takes the next frames for the rest of one that was cut. So after opening and after `recall`
    filler is written first, which ends any frame that the other end has begun.
    """

    datagrams = False
    rate = math.inf

    def __init__(self) -> None:
        self._rest = b""
        """The part of the newest frame that the device has not taken yet."""
        self._filler = FILLER
        self._refused = False
        self._tells = False
        """Whether the kernel has ever reported waiting bytes. Only then its 0 says that none wait."""
        self._taken = self._left = 0
        """Bytes that the device took, and how many of these have left this computer."""
        self._revocable_to = 0
        """Bytes that the device has taken when it has taken the newest revocable frame."""
        self._moved_at: float | None = None

    def _send(self, data: bytes) -> int:
        raise NotImplementedError

    def _drop(self) -> None:
        """Make the kernel drop what it holds, now or when the device is closed."""
        raise NotImplementedError

    def fileno(self) -> int:
        raise NotImplementedError

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Do nothing: a stream has one peer only."""

    def write(self, frame: bytes) -> bool:
        if self._filler:
            self._rest, self._filler = self._filler, b""
        if not self._finish():
            return False
        sent = self._push(frame)
        self._rest = frame[sent:] if sent else b""
        self._refused = not sent
        return sent > 0

    def check(self, now: float) -> None:
        self._finish()
        waits = self._unconfirmed()
        left = self._taken - waits
        if self._refused:
            self._refused = not select.select([], [self.fileno()], [], 0)[1]
        nothing_waits = not (waits or self._rest or self._refused)
        if nothing_waits or left != self._left or self._moved_at is None:
            self._left, self._moved_at = left, now
        elif now - self._moved_at >= STUCK_AFTER:
            self._drop()
            raise StuckError(errno.EIO, STUCK)

    def idle(self) -> bool:
        return self._finish() and not self._refused and self._unconfirmed() == 0

    def note_revocable(self) -> None:
        self._revocable_to = self._taken + len(self._rest)

    def settled(self) -> bool:
        return self._taken - self._unconfirmed() >= self._revocable_to and self._tells

    def recall(self) -> None:
        if self.settled():
            return
        self._drop()
        self._rest, self._filler = b"", FILLER

    def _unconfirmed(self) -> int:
        count = unconfirmed_bytes(self.fileno())
        self._tells |= count > 0
        return count

    def _finish(self) -> bool:
        """Send the rest of a frame that was begun; whether all of it was taken."""
        if self._rest:
            self._rest = self._rest[self._push(self._rest) :]
        return not self._rest

    def _push(self, data: bytes) -> int:
        sent = self._send(data)
        self._taken += sent
        self._tells = self._tells or self._unconfirmed() > 0
        return sent


class Tcp(Stream):
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
            data = self._socket.recv(CHUNK)
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

    def settled(self) -> bool:
        # What was sent once and is not confirmed is on its way.
        return self._taken - unsent_bytes(self.fileno()) >= self._revocable_to

    def recall(self) -> None:
        if not self.settled():
            self._drop()  # what waits in the kernel can only go with the socket
            raise StuckError(errno.EIO, STUCK)

    def has_room(self) -> bool:
        return self._finish() and unsent_bytes(self.fileno()) == 0

    def _drop(self) -> None:
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()


class Serial(Stream):
    """Exchanges bytes over a serial port, which pyserial opens."""

    def __init__(self, address: Address) -> None:
        super().__init__()
        self._port = open_port(address.place, address.number)
        self.rate = address.number / BITS_PER_BYTE

    def read(self) -> bytes:
        return self._port.read(CHUNK)

    def has_room(self) -> bool:
        return self._finish() and self._unconfirmed() <= ROOM * self.rate

    def _send(self, data: bytes) -> int:
        try:
            return self._port.write(data)
        except BlockingIOError:
            return 0

    def _drop(self) -> None:
        self._port.discard_output()

    def fileno(self) -> int:
        return self._port.fileno()

    def close(self) -> None:
        self._port.close()


def completes(frame: bytes) -> bool:
    """Whether FILLER makes a valid frame of a part of `frame`, so that cutting it would not destroy it."""
    mav = mavlink.MAVLink(None)
    for cut in range(1, len(frame)):
        try:
            mav.decode(bytearray(frame[:cut].ljust(len(frame), b"\0")))
        except mavlink.MAVError:
            continue
        return True
    return False
