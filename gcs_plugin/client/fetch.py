"""Fetches a file from a rover over MAVLink FTP, and requests again only the parts that are missing."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ftp import MAX_DATA, FtpError, FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID

LIFETIME_S = 60.0
"""A fetch fails after this time without a new byte."""
FIRST_BACK_OFF_S = 0.8
LONGEST_BACK_OFF_S = 4.0
FULL_S = 3.0
"""Pause before the next try when all of the companion's file sessions are in use."""
MAX_BYTES = 8 << 20
_READS = (Opcode.READ_FILE, Opcode.BURST_READ_FILE)


class FetchStatus(Enum):
    """Names the status of a fetch. The last two are final."""

    WAITING = "waiting"
    """Not sent yet: no heartbeat of the companion is received."""
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


@dataclass(eq=False)
class Transfer:
    """Paces requests to one rover, each sent again until it is answered, up to a time limit.

    problem: why it failed, for a person. session: 1 to 255, random; 0 is left to other clients on the same
    radio, which commonly use it.
    """

    system: int
    path: str
    created: float
    session: int = field(default_factory=lambda: 1 + secrets.randbelow(255))
    status: FetchStatus = FetchStatus.WAITING
    problem: str = ""
    _sequence: int = 0
    _unanswered: int = 0
    _next_at: float = 0.0
    _progress_at: float = 0.0
    _AWAITED: ClassVar[str] = "reply"

    def __post_init__(self) -> None:
        self._next_at = self._progress_at = self.created

    @property
    def settled(self) -> bool:
        """Whether all was received, or it has failed."""
        return self.status in (FetchStatus.DONE, FetchStatus.FAILED)

    def settle(self, now: float) -> bool:
        """Apply the time limit; return True when it settled the transfer in this call."""
        if self.settled or now - self._progress_at < LIFETIME_S:
            return False
        self._fail(f"no {self._AWAITED} for {LIFETIME_S:.0f} s: is the companion heard?")
        return True

    def _back_off(self, now: float) -> None:
        """Set when the request that is sent now is sent again."""
        self.status = FetchStatus.RUNNING
        self._next_at = now + min(FIRST_BACK_OFF_S * 1.5**self._unanswered, LONGEST_BACK_OFF_S)
        self._unanswered = min(self._unanswered + 1, 8)

    def _fail(self, problem: str) -> None:
        self.status, self.problem = FetchStatus.FAILED, problem

    def _request(self, opcode: Opcode, *, data: bytes = b"", offset: int = 0, size: int = 0) -> Any:
        self._sequence = (self._sequence + 1) & 0xFFFF
        request = FtpPayload(
            self._sequence, self.session, opcode, size or len(data), offset=offset, data=data
        )
        return mavlink.MAVLink_file_transfer_protocol_message(0, self.system, COMPONENT_ID, request.pack())


@dataclass(eq=False)
class Fetch(Transfer):
    """Fetches one file of one rover. The owner sends what `due` returns, and passes replies to `receive`.

    size: bytes, None until the companion has reported it.
    _received_bytes: one byte for each byte of the file, 1 where it was received.
    """

    size: int | None = None
    _content: bytearray = field(default_factory=bytearray, repr=False)
    _received_bytes: bytearray = field(default_factory=bytearray, repr=False)
    _opened: bool = False
    _session_ended: bool = False
    _AWAITED: ClassVar[str] = "byte"

    @property
    def received(self) -> int:
        """The number of bytes received so far."""
        return self._received_bytes.count(1)

    @property
    def content(self) -> bytes:
        """The file, once it is `DONE`."""
        return bytes(self._content)

    def due(self, now: float) -> Any | None:
        """Return the request to send now, or None; after the last byte it ends the session."""
        if self._session_ended or now < self._next_at:
            return None
        if self.settled:
            self._session_ended = True
            return self._request(Opcode.TERMINATE_SESSION)
        self._back_off(now)
        if not self._opened:
            return self._request(Opcode.OPEN_FILE_RO, data=self.path.encode())
        # What is missing up to the end comes as one burst; a gap between received parts is read by itself.
        gap = self._received_bytes.find(0)
        end = self._received_bytes.find(1, gap)
        if end < 0:
            return self._request(Opcode.BURST_READ_FILE, offset=gap, size=MAX_DATA)
        return self._request(Opcode.READ_FILE, offset=gap, size=min(MAX_DATA, end - gap))

    def receive(self, reply: FtpPayload, now: float) -> None:
        """Take in a file transfer message of this rover; those of other sessions are ignored."""
        if self.settled or reply.session != self.session or self.status is FetchStatus.WAITING:
            return
        if reply.opcode == Opcode.NAK and reply.data:
            self._refused(reply, now)
        elif reply.opcode == Opcode.ACK and reply.request == Opcode.OPEN_FILE_RO and reply.size == 4:
            self._open(int.from_bytes(reply.data, "little"), now)
        elif reply.opcode == Opcode.ACK and reply.request in _READS and self._opened:
            self._take(reply, now)

    def settle(self, now: float) -> bool:
        """Apply the time limit, after which no session is left to end."""
        timed_out = super().settle(now)
        self._session_ended = self._session_ended or timed_out
        return timed_out

    def _open(self, size: int, now: float) -> None:
        if self._opened:
            return
        if size > MAX_BYTES:
            self._fail(f"it is {size} bytes, more than {MAX_BYTES}")
            return
        if size != self.size:
            self.size, self._content, self._received_bytes = size, bytearray(size), bytearray(size)
        self._opened = True
        self._note_progress(now, at_once=True)

    def _take(self, reply: FtpPayload, now: float) -> None:
        end = reply.offset + len(reply.data)
        if end > len(self._content):
            return
        fresh = self._received_bytes[reply.offset : end].count(0)
        self._content[reply.offset : end] = reply.data
        self._received_bytes[reply.offset : end] = b"\1" * len(reply.data)
        last = reply.burst_complete or reply.request == Opcode.READ_FILE
        if fresh or last:
            self._note_progress(now, at_once=last)

    def _note_progress(self, now: float, *, at_once: bool) -> None:
        self._progress_at, self._unanswered = now, 0
        self._next_at = now if at_once else now + FIRST_BACK_OFF_S
        if self._received_bytes.find(0) < 0:
            self.status, self._next_at = FetchStatus.DONE, now

    def _refused(self, reply: FtpPayload, now: float) -> None:
        error = reply.data[0]
        if reply.request in _READS and error == FtpError.INVALID_SESSION:
            # the companion has closed the session or restarted: open the file again
            self._opened, self._next_at = False, now
        elif reply.request == Opcode.OPEN_FILE_RO and error == FtpError.NO_SESSIONS_AVAILABLE:
            self._next_at = now + FULL_S
        elif reply.request == Opcode.OPEN_FILE_RO or (reply.request in _READS and self._opened):
            missing = error == FtpError.FILE_NOT_FOUND
            self._fail("the companion has no such file" if missing else f"refused with error {error}")
