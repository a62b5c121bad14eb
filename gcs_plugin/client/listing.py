"""Lists a folder of a rover over MAVLink FTP."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.ftp import FtpError, FtpPayload, Opcode
from companion.wire.ids import COMPONENT_ID
from gcs_plugin.client.fetch import FIRST_BACK_OFF_S, LIFETIME_S, LONGEST_BACK_OFF_S, FetchStatus

MAX_NAMES = 2000


@dataclass(eq=False)
class Listing:
    """Lists one folder. It is used like a `Fetch`. names: of its files, once it is `DONE`."""

    system: int
    path: str
    created: float
    session: int = field(default_factory=lambda: 1 + secrets.randbelow(255))
    status: FetchStatus = FetchStatus.WAITING
    problem: str = ""
    names: list[str] = field(default_factory=list)
    _entries: int = 0
    _sequence: int = 0
    _unanswered: int = 0
    _next_at: float = 0.0
    _progress_at: float = 0.0

    def __post_init__(self) -> None:
        self._next_at = self._progress_at = self.created

    @property
    def settled(self) -> bool:
        """Whether the list is complete, or has failed."""
        return self.status in (FetchStatus.DONE, FetchStatus.FAILED)

    def due(self, now: float) -> Any | None:
        """Return the request to send now, or None."""
        if self.settled or now < self._next_at:
            return None
        self.status = FetchStatus.RUNNING
        self._next_at = now + min(FIRST_BACK_OFF_S * 1.5**self._unanswered, LONGEST_BACK_OFF_S)
        self._unanswered = min(self._unanswered + 1, 8)
        self._sequence = (self._sequence + 1) & 0xFFFF
        path = self.path.encode()
        request = FtpPayload(
            self._sequence, self.session, Opcode.LIST_DIRECTORY, len(path), offset=self._entries, data=path
        )
        return mavlink.MAVLink_file_transfer_protocol_message(0, self.system, COMPONENT_ID, request.pack())

    def receive(self, reply: FtpPayload, now: float) -> None:
        """Take in a reply; those to other requests are ignored."""
        if self.settled or reply.session != self.session or reply.request != Opcode.LIST_DIRECTORY:
            return
        if reply.opcode == Opcode.NAK and reply.data:
            self._refused(reply.data[0])
        elif reply.opcode == Opcode.ACK and reply.offset == self._entries:
            entries = [entry for entry in reply.data.split(b"\0") if entry]
            if not entries or self._entries + len(entries) > MAX_NAMES:
                self._fail("its list cannot be")
                return
            self._entries += len(entries)
            files = (entry[1:].partition(b"\t")[0] for entry in entries if entry[:1] == b"F")
            self.names += [name.decode(errors="replace") for name in files]
            self._progress_at, self._unanswered, self._next_at = now, 0, now

    def settle(self, now: float) -> bool:
        """Apply the time limit; return True when it settled the list in this call."""
        if self.settled or now - self._progress_at < LIFETIME_S:
            return False
        self._fail(f"no reply for {LIFETIME_S:.0f} s: is the companion heard?")
        return True

    def _refused(self, error: int) -> None:
        if error == FtpError.END_OF_FILE:
            self.status = FetchStatus.DONE
        elif error != FtpError.NO_SESSIONS_AVAILABLE:
            missing = error == FtpError.FILE_NOT_FOUND
            self._fail("the companion has no such folder" if missing else f"refused with error {error}")

    def _fail(self, problem: str) -> None:
        self.status, self.problem = FetchStatus.FAILED, problem
