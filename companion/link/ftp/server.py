"""Serves files over MAVLink FTP. Every accepted sender may read; nothing can be written."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

from companion.link import encode
from companion.link.access_control import AccessControl
from companion.link.ftp.sessions import Burst, FtpSession, Lists, Sessions
from companion.link.outbox import Outbox
from companion.storage.served_tree import FileError, LaterError, MissingError, Opened, Tree
from companion.wire.ftp import MAX_DATA, SMALL_DATA, WRITES, FtpError, FtpPayload, Opcode
from companion.wire.ids import SenderId
from companion.wire.packing import PayloadError

BURST_FRAMES = 64
"""Frames of one burst at most, which bounds what a vanished client costs."""
BURST_FOR = 2.0
"""s of one burst at most: pymavlink's client gives up after 3.7 s without a request of its own."""
BURST_REPEAT = 0.3
"""s in which the same burst request is a copy made by the network: clients wait longer before they repeat."""
NARROW = 10_000.0
"""B/s of budget up to which a burst is sent in short frames."""
MAX_REPLIES = 8
"""Replies to one sender that wait; beyond, its requests are dropped."""
MAX_LATER = 8
"""Requests that wait for the disk, one for each session; beyond, they fail at once."""
MAX_CHECKED = 1024 * 1024
"""Bytes of the largest file whose CRC is computed, because the whole link waits meanwhile."""
_BLOCK = 64 * 1024


class FtpServer:
    """Answers FILE_TRANSFER_PROTOCOL. Every request may arrive twice."""

    def __init__(self, outbox: Outbox, access: AccessControl, tree: Tree) -> None:
        self._outbox = outbox
        self._access = access
        self._tree = tree
        self._sessions = Sessions()
        self._lists = Lists(tree)
        self._later: dict[tuple[SenderId, int], FtpPayload] = {}
        """(sender, session) -> request that waits for the disk."""

    @property
    def open_files(self) -> int:
        """How many files are open."""
        return len(self._sessions)

    def receive(self, sender: SenderId, message: Any, now: float) -> None:
        """Take a request. A reply is never answered: two servers would answer each other without end."""
        try:
            request = FtpPayload.unpack(bytes(message.payload))
        except PayloadError:
            self._access.rejected["payload"] += 1
            return
        if (
            request.opcode in (Opcode.ACK, Opcode.NAK)
            or self._later.get((sender, request.session)) == request
        ):
            return
        if self._outbox.waiting("file reply", to=sender) >= MAX_REPLIES:
            self._access.rejected["file queue"] += 1
            return
        reply = self._reply(sender, request, now)
        if reply is not None:
            self._send_reply(sender, reply, now)

    def tick(self, now: float) -> None:
        """Retry the requests that wait for the disk, and queue the next frame of each burst.

        A burst queues a frame only when none of its kind waits for its client, so that it never fills a
        queue.
        """
        self._sessions.tick(now)
        for (sender, _), request in list(self._later.items()):
            if (reply := self._reply(sender, request, now)) is not None:
                self._send_reply(sender, reply, now)
        for session in self._sessions.bursting():
            if not self._outbox.waiting("file data", to=session.sender):
                self._queue_burst_frame(session, now)
                self._sessions.had_turn(session)

    def _data_size(self, sender: SenderId) -> int:
        channel = self._outbox.channel(sender)
        if channel is None:
            return SMALL_DATA
        wide = channel.asked_budget == 0 or channel.asked_budget > NARROW
        # MAVLink 1 sends all 251 bytes of the payload, zeros too: short data would save nothing.
        return MAX_DATA if wide or channel.sender.version.is_1 else SMALL_DATA

    def _reply(self, sender: SenderId, request: FtpPayload, now: float) -> FtpPayload | None:
        """The reply to a request; None when it comes later or never. A session's newest request counts."""
        waited = self._later.pop((sender, request.session), None)
        try:
            match request.opcode:
                case Opcode.TERMINATE_SESSION | Opcode.RESET_SESSIONS:
                    self._sessions.end(sender, request)
                    if request.opcode == Opcode.RESET_SESSIONS:
                        self._later = {one: later for one, later in self._later.items() if one[0] != sender}
                    return request.ack()
                case Opcode.LIST_DIRECTORY:
                    page = self._lists.page(sender, request, self._data_size(sender))
                    return request.ack(page) if page else request.nak(FtpError.END_OF_FILE)
                case Opcode.OPEN_FILE_RO:
                    return self._open(sender, request, now)
                case Opcode.READ_FILE | Opcode.BURST_READ_FILE:
                    return self._read(sender, request, now)
                case Opcode.CALC_FILE_CRC32:
                    return self._checksum(request)
                case Opcode.NONE:
                    return request.ack()
                case other:
                    return request.nak(
                        FtpError.FILE_PROTECTED if other in WRITES else FtpError.UNKNOWN_COMMAND
                    )
        except LaterError:
            if waited is None and len(self._later) >= MAX_LATER:
                return request.nak(FtpError.FAIL)
            self._later[sender, request.session] = request
            return None
        except (MissingError, PayloadError):
            return request.nak(FtpError.FILE_NOT_FOUND)
        except FileError:
            return request.nak(FtpError.FAIL)

    def _open(self, sender: SenderId, request: FtpPayload, now: float) -> FtpPayload | None:
        session = self._sessions.repeated(sender, request, now)
        if session is None:
            if self._sessions.is_late_copy(sender, request, now):
                return None
            if not self._sessions.has_room(sender) and not self._outranks(sender):
                return request.nak(FtpError.NO_SESSIONS_AVAILABLE)
            opened = self._tree.open(request.path())
            session = self._sessions.open(sender, request, opened, now)
        return request.ack(session.opened.size.to_bytes(4, "little"))

    def _outranks(self, sender: SenderId) -> bool:
        """Whether a session of a sender with less right could be ended for `sender`."""
        return self._sessions.make_room(by=lambda other: self._access.outranks(sender, other))

    def _read(self, sender: SenderId, request: FtpPayload, now: float) -> FtpPayload | None:
        session = self._sessions.get(sender, request.session)
        if session is None:
            return request.nak(FtpError.INVALID_SESSION)
        session.use(request, now)
        if request.offset >= session.opened.size:
            return request.nak(FtpError.END_OF_FILE)
        asked = request.size or self._data_size(sender)
        if request.opcode == Opcode.READ_FILE:
            return request.ack(session.opened.read(request.offset, asked))
        running = session.burst
        if running is None or running.request != request or now - running.started > BURST_REPEAT:
            step = min(asked, self._data_size(sender))
            session.burst = Burst(request, now, request.sequence, request.offset, step, asked, BURST_FRAMES)
            if running is not None:  # replace the waiting frame of the old burst
                self._queue_burst_frame(session, now)
        return None

    def _queue_burst_frame(self, session: FtpSession, now: float) -> None:
        burst = session.burst
        assert burst is not None
        burst.left -= 1
        burst.sequence += 1
        last = burst.left == 0 or now - burst.started >= BURST_FOR
        # A client takes a last frame that is shorter than requested for the end of the file.
        count = burst.asked if last else burst.step
        request = replace(burst.request, sequence=burst.sequence - 1 & 0xFFFF)
        try:
            data = session.opened.read(burst.offset, count)
        except FileError:
            session.burst = None
            self._send_reply(session.sender, request.nak(FtpError.FAIL), now)
            return
        reply = request.ack(data, offset=burst.offset)
        burst.offset += len(data)
        if last or burst.offset >= session.opened.size:
            session.burst = None
            reply = replace(reply, burst_complete=True)
        session.used_at = now
        message = encode.file_transfer(reply.pack(), session.sender)
        key = (session.sender, session.number)
        self._outbox.push("file data", message, now, key=key, to=session.sender)

    def _checksum(self, request: FtpPayload) -> FtpPayload:
        opened = self._tree.open(request.path())
        try:
            if opened.size > MAX_CHECKED:
                return request.nak(FtpError.FAIL)
            return request.ack(_crc(opened).to_bytes(4, "little"))
        finally:
            opened.close()

    def _send_reply(self, sender: SenderId, reply: FtpPayload, now: float) -> None:
        key = (sender, reply.session, reply.sequence, reply.request)
        message = encode.file_transfer(reply.pack(), sender)
        self._outbox.push("file reply", message, now, key=key, to=sender)


def _crc(opened: Opened) -> int:
    """CRC-32 that starts at 0 and is not inverted, as MAVLink's FTP specifies."""
    crc = 0xFFFFFFFF
    for offset in range(0, opened.size, _BLOCK):
        crc = zlib.crc32(opened.read(offset, _BLOCK), crc)
    return crc ^ 0xFFFFFFFF
