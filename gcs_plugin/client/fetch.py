"""Fetches a file from a rover over MAVLink FTP, and requests again only the parts that are missing."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ftp import MAX_DATA, FtpError, FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID
from gcs_plugin.client.reply_pace import FIRST_BACK_OFF_S, ReplyPace

LIFETIME_S = 60.0
"""A fetch fails after this time without a new byte."""
LONGEST_BACK_OFF_S = 4.0
MOST_READS = 4
"""Reads under way at once: the rover queues eight replies, and the operator's uplink is the same radio."""
SILENCES = 3
"""So many in a row, and there is one read at a time until a reply comes."""
FULL_S = 3.0
"""Pause before the next try when all of the companion's file sessions are in use."""
MAX_BYTES = 8 << 20
MOST_UNANSWERED = 24
"""Silences in a row from which back-offs grow no further."""
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
    radio, which commonly use it. background: nobody waits for it.
    """

    system: int
    path: str
    created: float
    session: int = field(default_factory=lambda: 1 + secrets.randbelow(255))
    status: FetchStatus = FetchStatus.WAITING
    problem: str = ""
    background: bool = False
    _sequence: int = 0
    _unanswered: int = 0
    _next_at: float = 0.0
    _progress_at: float = 0.0
    _AWAITED: ClassVar[str] = "reply"
    _FIRST_BACK_OFF_S: ClassVar[float] = 0.8
    _GROWTH: ClassVar[float] = 1.5

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
        self._next_at = now + min(self._FIRST_BACK_OFF_S * self._GROWTH**self._unanswered, LONGEST_BACK_OFF_S)
        self._unanswered = min(self._unanswered + 1, MOST_UNANSWERED)

    def _fail(self, problem: str) -> None:
        self.status, self.problem = FetchStatus.FAILED, problem

    def _request(self, opcode: Opcode, *, data: bytes = b"", offset: int = 0, size: int = 0) -> Any:
        self._sequence = (self._sequence + 1) & 0xFFFF
        request = FtpPayload(
            self._sequence, self.session, opcode, size or len(data), offset=offset, data=data
        )
        return mavlink.MAVLink_file_transfer_protocol_message(0, self.system, COMPONENT_ID, request.pack())


@dataclass
class _Read:
    """A read that is under way: of the bytes from `first` up to `end`, sent at `sent`."""

    first: int
    end: int
    sent: float


@dataclass(eq=False)
class Fetch(Transfer):
    """Fetches one file of one rover. The owner sends what `due` returns, and passes replies to `receive`.

    The file comes as a burst. While that goes on, the parts of it that were lost are read, several at once.
    The companion answers reads before it goes on with a burst, and in their order: when a later one is
    answered, an earlier one is lost.

    size: bytes, None until the companion has reported it.
    _received_bytes: one byte for each byte of the file, 1 where it was received.
    _reads: what is under way, by the sequence numbers of the requests, oldest first.
    _burst_at: the offset up to which the burst has come; None: none is under way.
    _step: bytes of a burst's frame, and so of a read: a longer frame would be lost more often.
    """

    size: int | None = None
    _content: bytearray = field(default_factory=bytearray, repr=False)
    _received_bytes: bytearray = field(default_factory=bytearray, repr=False)
    _opened: bool = False
    _session_ended: bool = False
    _reads: dict[int, _Read] = field(default_factory=dict)
    _burst_at: int | None = None
    _step: int = MAX_DATA
    _asked_at: float = 0.0
    _pace: ReplyPace = field(default_factory=ReplyPace)
    _AWAITED: ClassVar[str] = "byte"
    _FIRST_BACK_OFF_S: ClassVar[float] = FIRST_BACK_OFF_S
    _GROWTH: ClassVar[float] = 1.1  # requests and replies are short, and on a bad radio silence means loss

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
        if self.settled:
            return self.end()
        if not self._opened:
            return self._open_request(now)
        if self._under_way and now >= self._next_at:
            self._forget_requests()
            self._unanswered = min(self._unanswered + 1, MOST_UNANSWERED)
        part = self._part_to_read(now)
        if part is None:
            return None
        if not self._under_way:
            self._wait(now)
        self._asked_at = now
        first, end = part
        to_the_end = end == self.size and self._burst_at is None
        if to_the_end and (end - first > MOST_READS * self._step or not self.received):
            self._burst_at = first
            self._pace.begin_burst(now)
            return self._request(Opcode.BURST_READ_FILE, offset=first, size=MAX_DATA)
        end = min(end, first + self._step)
        request = self._request(Opcode.READ_FILE, offset=first, size=end - first)
        self._reads[self._sequence] = _Read(first, end, now)
        return request

    def end(self) -> Any | None:
        """Return what ends the session, once; None when none can be open."""
        if self._session_ended or self.status is FetchStatus.WAITING:
            return None
        self._session_ended = True
        return self._request(Opcode.TERMINATE_SESSION)

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

    def resume(self, now: float) -> None:
        """Fetch what is missing, after it has failed or was ended. What was received counts if the file still
        has its size, so do so only with one whose content never changes.
        """
        self.status, self.problem = FetchStatus.WAITING, ""
        self.session = 1 + secrets.randbelow(255)
        self._opened = self._session_ended = False
        self._forget_requests()
        self._unanswered, self._next_at, self._progress_at = 0, now, now

    def settle(self, now: float) -> bool:
        """Apply the time limit, after which no session is left to end."""
        timed_out = super().settle(now)
        self._session_ended = self._session_ended or timed_out
        return timed_out

    @property
    def _under_way(self) -> bool:
        return bool(self._reads) or self._burst_at is not None

    def _forget_requests(self) -> None:
        self._reads.clear()
        self._burst_at = None

    def _open_request(self, now: float) -> Any | None:
        """Return the request to open the file, when it is due.

        A repetition has the same sequence number, so that a document is not made anew for it.
        """
        if now < self._next_at:
            return None
        if self._unanswered:
            self._sequence -= 1
        self._back_off(now)
        return self._request(Opcode.OPEN_FILE_RO, data=self.path.encode())

    def _part_to_read(self, now: float) -> tuple[int, int] | None:
        """Return offset and end of the first part that is missing and not under way.

        When there is none, the oldest read goes again after a while: it may be the last part of the file.
        """
        if len(self._reads) >= (MOST_READS if self._unanswered < SILENCES else 1):
            return None
        at, size = 0, len(self._content) if self._burst_at is None else self._burst_at
        under_way = sorted((read.first, read.end) for read in self._reads.values())
        for first, end in [*under_way, (size, size)]:
            gap = self._received_bytes.find(0, at, first)
            if gap >= 0:
                stop = self._received_bytes.find(1, gap, first)
                return gap, first if stop < 0 else stop
            at = max(at, end)
        if not self._reads or now - self._asked_at < self._pace.probe:
            return None
        oldest = next(iter(self._reads.values()))
        return oldest.first, oldest.end

    def _open(self, size: int, now: float) -> None:
        if self._opened:
            return
        if size > MAX_BYTES:
            self._fail(f"it is {size} bytes, more than {MAX_BYTES}")
            return
        if size != self.size:
            self.size, self._content, self._received_bytes = size, bytearray(size), bytearray(size)
        self._opened = True
        self._note_progress(now)

    def _take(self, reply: FtpPayload, now: float) -> None:
        end = reply.offset + len(reply.data)
        if end > len(self._content):
            return
        self._note_reply(reply, end, now)
        fresh = self._received_bytes[reply.offset : end].count(0)
        self._content[reply.offset : end] = reply.data
        self._received_bytes[reply.offset : end] = b"\1" * len(reply.data)
        if fresh:
            self._note_progress(now)

    def _note_reply(self, reply: FtpPayload, end: int, now: float) -> None:
        """Note what a reply says of the requests under way."""
        self._unanswered = 0
        if reply.request == Opcode.READ_FILE:
            read = self._reads.get(reply.sequence - 1 & 0xFFFF)
            if read is not None:
                self._pace.reply_took(now - read.sent)
                self._reads = {key: one for key, one in self._reads.items() if one.sent > read.sent}
        elif self._burst_at is not None:
            self._pace.frame_came(reply.sequence, now)
            if reply.burst_complete:
                self._burst_at = None
            else:
                self._burst_at = max(self._burst_at, end)
                self._step = len(reply.data) or MAX_DATA
        self._wait(now)

    def _wait(self, now: float) -> None:
        """Set when, without a reply, all that is under way is taken for lost."""
        self._next_at = now + min(self._pace.patience * self._GROWTH**self._unanswered, LONGEST_BACK_OFF_S)

    def _note_progress(self, now: float) -> None:
        self._progress_at, self._unanswered = now, 0
        if self._received_bytes.find(0) < 0:
            self.status = FetchStatus.DONE

    def _refused(self, reply: FtpPayload, now: float) -> None:
        error = reply.data[0]
        if reply.request in _READS and error == FtpError.INVALID_SESSION:
            # the companion has closed the session or restarted: open the file again
            self._opened, self._next_at, self._unanswered = False, now, 0
            self._forget_requests()
        elif reply.request == Opcode.OPEN_FILE_RO and error == FtpError.NO_SESSIONS_AVAILABLE:
            self._next_at = now + FULL_S
        elif reply.request == Opcode.OPEN_FILE_RO or (reply.request in _READS and self._opened):
            missing = error == FtpError.FILE_NOT_FOUND
            self._fail("the companion has no such file" if missing else f"refused with error {error}")
