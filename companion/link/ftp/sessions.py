"""Lists of folders, and files that are open for somebody."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from companion.link.inbound import Sender
from companion.storage.served_tree import Entry, Opened, Tree
from companion.wire.ftp import FtpPayload, Opcode

MAX_LISTS = 8


class Lists:
    """Remembers the last list of eight senders, so that it does not change from one page to the next."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self._newest_lists: OrderedDict[Sender, tuple[str, tuple[Entry, ...]]] = OrderedDict()

    def page(self, sender: Sender, request: FtpPayload, room: int) -> bytes:
        """Whole entries of the folder asked for, from number `request.offset`: one and what fits `room`.

        Empty after the last. Raises FileError, PayloadError.
        """
        data = b""
        for entry in self._entries(sender, request)[request.offset :]:
            line = _line(entry)
            if data and len(data) + len(line) > room:
                break
            data += line
        return data

    def _entries(self, sender: Sender, request: FtpPayload) -> tuple[Entry, ...]:
        path = request.path()
        listed_path, entries = self._newest_lists.get(sender, ("", ()))
        if request.offset == 0 or listed_path != path:
            entries = self._tree.entries(path)
            self._newest_lists[sender] = path, entries
            self._newest_lists.move_to_end(sender)
            if len(self._newest_lists) > MAX_LISTS:
                self._newest_lists.popitem(last=False)
        return entries


def _line(entry: Entry) -> bytes:
    """Type, name, size and a NUL: one client overwrites the last byte of what it gets."""
    text = f"D{entry.name}" if entry.size is None else f"F{entry.name}\t{entry.size}"
    return text.encode() + b"\0"


MAX_SESSIONS = 4
SESSIONS_PER_SENDER = 2
MAX_PAST = 16
IDLE = 30.0
REPEAT_WITHIN = 3.0


@dataclass
class Burst:
    """What is being sent by itself. step: bytes a frame; asked: bytes a frame that the client asked for."""

    request: FtpPayload
    started: float
    sequence: int
    offset: int
    step: int
    asked: int
    left: int


@dataclass
class Session:
    """One open file. opening: the request that opened it. sequence: the newest heard in it."""

    sender: Sender
    opening: FtpPayload
    opened: Opened
    used_at: float
    sequence: int
    burst: Burst | None = None

    @property
    def number(self) -> int:
        """As the client calls it."""
        return self.opening.session

    def outlives(self, request: FtpPayload) -> bool:
        """Whether `request` was sent before the newest of this session, and came late.

        By the low byte: one client counts to 255 only.
        """
        return (request.sequence - self.sequence) & 0xFF >= 0x80

    def use(self, request: FtpPayload, now: float) -> None:
        """`request` is for this session."""
        self.used_at = now
        if not self.outlives(request):
            self.sequence = request.sequence


class Sessions:
    """At most four, two for one sender, closed after 30 s without a request."""

    def __init__(self) -> None:
        self._open: dict[tuple[Sender, int], Session] = {}
        self._closed: deque[tuple[Sender, FtpPayload]] = deque(maxlen=MAX_PAST)

    def __len__(self) -> int:
        return len(self._open)

    def __iter__(self) -> Iterator[Session]:
        return iter(self._open.values())

    def get(self, sender: Sender, number: int) -> Session | None:
        """The sender's session of this number."""
        return self._open.get((sender, number))

    def repeated(self, sender: Sender, request: FtpPayload, now: float) -> Session | None:
        """The session that this very request has just opened, when its answer was lost."""
        session = self.get(sender, request.session)
        if session is None or session.opening != request or now - session.used_at > REPEAT_WITHIN:
            return None
        return session

    def overtaken(self, sender: Sender, request: FtpPayload, now: float) -> bool:
        """Whether it is a late copy of what opened the session's file before the one that is read now."""
        session = self.get(sender, request.session)
        if session is None or now - session.used_at > REPEAT_WITHIN:
            return False
        return session.outlives(request) and (sender, request) in self._closed

    def has_room(self, sender: Sender) -> bool:
        """Whether `sender` may open one more; its own make room for it."""
        return len(self._open) < MAX_SESSIONS or any(session.sender == sender for session in self)

    def make_room(self, by: Callable[[Sender], bool]) -> bool:
        """Whether the longest idle session `by` one of these could be ended."""
        idle = min((one for one in self if by(one.sender)), key=lambda one: one.used_at, default=None)
        if idle is not None:
            self.close(idle.sender, idle.number)
        return idle is not None

    def open(self, sender: Sender, request: FtpPayload, opened: Opened, now: float) -> Session:
        """A new session; ends the sender's own of that number, and its longest idle one of too many."""
        self.close(sender, request.session)
        own = sorted((one for one in self if one.sender == sender), key=lambda one: one.used_at)
        if own and (len(own) >= SESSIONS_PER_SENDER or len(self._open) >= MAX_SESSIONS):
            self.close(sender, own[0].number)
        session = Session(sender, request, opened, now, request.sequence)
        self._open[sender, request.session] = session
        return session

    def close(self, sender: Sender, number: int) -> None:
        """The file is not needed any more."""
        session = self._open.pop((sender, number), None)
        if session is not None:
            session.opened.close()
            self._closed.append((sender, session.opening))

    def end(self, sender: Sender, request: FtpPayload) -> None:
        """The sender ends one session, or all with RESET_SESSIONS; never one younger than the request."""
        for session in [one for one in self if one.sender == sender and not one.outlives(request)]:
            if request.opcode == Opcode.RESET_SESSIONS or session.number == request.session:
                self.close(sender, session.number)

    def tick(self, now: float) -> None:
        """End what nobody asks for."""
        for session in [one for one in self if now - one.used_at > IDLE]:
            self.close(session.sender, session.number)

    def bursting(self) -> list[Session]:
        """Those that have something to send, in the order of their turns."""
        return [session for session in self if session.burst is not None]

    def had_turn(self, session: Session) -> None:
        """All others come first now."""
        key = (session.sender, session.number)
        self._open[key] = self._open.pop(key)
