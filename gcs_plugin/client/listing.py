"""Lists a folder of a rover over MAVLink FTP."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from companion.wire.ftp import FtpError, FtpPayload, Opcode
from gcs_plugin.client.fetch import FetchStatus, Transfer

MAX_NAMES = 2000


@dataclass(eq=False)
class Listing(Transfer):
    """Lists one folder. It is used like a `Fetch`. names: of its files, once it is `DONE`."""

    names: list[str] = field(default_factory=list)
    _entries: int = 0

    def due(self, now: float) -> Any | None:
        """Return the request to send now, or None."""
        if self.settled or now < self._next_at:
            return None
        self._back_off(now)
        return self._request(Opcode.LIST_DIRECTORY, data=self.path.encode(), offset=self._entries)

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

    def _refused(self, error: int) -> None:
        if error == FtpError.END_OF_FILE:
            self.status = FetchStatus.DONE
        elif error != FtpError.NO_SESSIONS_AVAILABLE:
            missing = error == FtpError.FILE_NOT_FOUND
            self._fail("the companion has no such folder" if missing else f"refused with error {error}")
