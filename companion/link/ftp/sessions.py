"""Stores the folder listings and open files of MAVLink FTP clients."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from companion.storage.served_tree import ListingEntry, Opened, Tree
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import SenderId

MAX_LISTS = 8


class Lists:
    """Lists folders. It stores the newest listing of eight senders, which must not change between pages."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self._newest_lists: OrderedDict[SenderId, tuple[str, tuple[ListingEntry, ...]]] = OrderedDict()

    def page(self, sender: SenderId, request: FtpPayload, room: int) -> bytes:
        """Whole entries of the requested folder from number `request.offset` on: one, and up to `room` bytes.

        Empty after the last entry. Raises FileError, PayloadError.
        """
        data = b""
        for entry in self._entries(sender, request)[request.offset :]:
            line = _line(entry)
            if data and len(data) + len(line) > room:
                break
            data += line
        return data

    def _entries(self, sender: SenderId, request: FtpPayload) -> tuple[ListingEntry, ...]:
        path = request.path()
        listed_path, entries = self._newest_lists.get(sender, ("", ()))
        if request.offset == 0 or listed_path != path:
            entries = self._tree.entries(path)
            self._newest_lists[sender] = path, entries
            self._newest_lists.move_to_end(sender)
            if len(self._newest_lists) > MAX_LISTS:
                self._newest_lists.popitem(last=False)
        return entries


def _line(entry: ListingEntry) -> bytes:
    """Encode type, name and size, and a NUL behind them: one client overwrites the last byte of a page."""
    text = f"D{entry.name}" if entry.size is None else f"F{entry.name}\t{entry.size}"
    return text.encode() + b"\0"


MAX_SESSIONS = 4
SESSIONS_PER_SENDER = 2
MAX_PAST = 16
"""Closed sessions whose opening request is remembered, to recognize late copies of it."""
IDLE = 30.0
"""s without a request after which a session is closed."""
REPEAT_WITHIN = 3.0
"""s in which the same opening request is a repetition."""


@dataclass
class Burst:
    """A burst read in progress. step: bytes a frame. asked: bytes a frame that the client asked for."""

    request: FtpPayload
    started: float
    sequence: int
    offset: int
    step: int
    asked: int
    left: int


@dataclass
class FtpSession:
    """One open file. opening: the request that opened it. sequence: of its newest request."""

    sender: SenderId
    opening: FtpPayload
    opened: Opened
    used_at: float
    sequence: int
    burst: Burst | None = None

    @property
    def number(self) -> int:
        """The session number that the client chose."""
        return self.opening.session

    def is_older(self, request: FtpPayload) -> bool:
        """Whether `request` was sent before this session's newest request, and arrived late.

        Only the low byte is compared, as one client counts to 255 only.
        """
        return (request.sequence - self.sequence) & 0xFF >= 0x80

    def use(self, request: FtpPayload, now: float) -> None:
        """Note that `request` uses this session."""
        self.used_at = now
        if not self.is_older(request):
            self.sequence = request.sequence


class Sessions:
    """Stores at most four sessions, two of one sender, and closes each after 30 s without a request."""

    def __init__(self) -> None:
        self._open: dict[tuple[SenderId, int], FtpSession] = {}
        self._closed: deque[tuple[SenderId, FtpPayload]] = deque(maxlen=MAX_PAST)

    def __len__(self) -> int:
        return len(self._open)

    def __iter__(self) -> Iterator[FtpSession]:
        return iter(self._open.values())

    def get(self, sender: SenderId, number: int) -> FtpSession | None:
        """The sender's session with this number; None when there is none."""
        return self._open.get((sender, number))

    def repeated(self, sender: SenderId, request: FtpPayload, now: float) -> FtpSession | None:
        """The session that the same request opened within the last 3 s: its reply was lost."""
        session = self.get(sender, request.session)
        if session is None or session.opening != request or now - session.used_at > REPEAT_WITHIN:
            return None
        return session

    def is_late_copy(self, sender: SenderId, request: FtpPayload, now: float) -> bool:
        """Whether `request` is a late copy of one that opened an earlier file in the same session."""
        session = self.get(sender, request.session)
        if session is None or now - session.used_at > REPEAT_WITHIN:
            return False
        return session.is_older(request) and (sender, request) in self._closed

    def has_room(self, sender: SenderId) -> bool:
        """Whether `sender` may open another session, in a free place or in place of one of its own."""
        return len(self._open) < MAX_SESSIONS or any(session.sender == sender for session in self)

    def make_room(self, by: Callable[[SenderId], bool]) -> bool:
        """End the longest idle session whose sender fulfils `by`; False when there is none."""
        idle = min((one for one in self if by(one.sender)), key=lambda one: one.used_at, default=None)
        if idle is not None:
            self.close(idle.sender, idle.number)
        return idle is not None

    def open(self, sender: SenderId, request: FtpPayload, opened: Opened, now: float) -> FtpSession:
        """Open a session; close the sender's one of that number, and its longest idle one above a limit."""
        self.close(sender, request.session)
        own = sorted((one for one in self if one.sender == sender), key=lambda one: one.used_at)
        if own and (len(own) >= SESSIONS_PER_SENDER or len(self._open) >= MAX_SESSIONS):
            self.close(sender, own[0].number)
        session = FtpSession(sender, request, opened, now, request.sequence)
        self._open[sender, request.session] = session
        return session

    def close(self, sender: SenderId, number: int) -> None:
        """Close a session and its file."""
        session = self._open.pop((sender, number), None)
        if session is not None:
            session.opened.close()
            self._closed.append((sender, session.opening))

    def end(self, sender: SenderId, request: FtpPayload) -> None:
        """Close the request's session, or all of the sender's with RESET_SESSIONS; none newer than it."""
        for session in [one for one in self if one.sender == sender and not one.is_older(request)]:
            if request.opcode == Opcode.RESET_SESSIONS or session.number == request.session:
                self.close(sender, session.number)

    def tick(self, now: float) -> None:
        """Close the sessions that were idle for 30 s."""
        for session in [one for one in self if now - one.used_at > IDLE]:
            self.close(session.sender, session.number)

    def bursting(self) -> list[FtpSession]:
        """The sessions with a burst in progress, in the order of their turns."""
        return [session for session in self if session.burst is not None]

    def had_turn(self, session: FtpSession) -> None:
        """Move `session` behind all others."""
        key = (session.sender, session.number)
        self._open[key] = self._open.pop(key)
