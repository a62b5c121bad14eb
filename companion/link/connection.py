"""Keeps one device open, and opens it again after it went away."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Callable

from companion.link.streams import ROOM, STUCK_AFTER, StuckError
from companion.link.transport import Transport

FIRST_RETRY = 0.5
LAST_RETRY = 8.0
_ABSENT = frozenset(
    {
        errno.ENOENT,
        errno.ENODEV,
        errno.ENXIO,
        errno.ECONNREFUSED,
        errno.EHOSTUNREACH,
        errno.ENETUNREACH,
        errno.ETIMEDOUT,
        errno.EADDRINUSE,
        errno.EADDRNOTAVAIL,
    }
)
"""errno of a device that is not there. Trying it again is cheap, so the delay between tries does not grow."""


class Connection:
    """Reads and writes a transport that may be absent, and opens it again. Raises nothing.

    An absent device is tried every 0.5 s. A device that opens and then fails is tried after 0.5 s, 1 s, ...
    8 s, because opening resets some devices. The delay starts at 0.5 s again once something was read, or was
    written 8 s or more after the opening. One that takes nothing for 1 s is opened again, too; it counts as
    working only once it takes something 2 s after that.

    opened: how often it was opened. trouble: the last error in words, None while the device works.
    """

    def __init__(self, opener: Callable[[], Transport], now: float) -> None:
        self._opener = opener
        self._transport: Transport | None = None
        self._retry_at = now
        self._delay = FIRST_RETRY
        self._opened_at = self._now = now
        self._line_free_at = now
        """When all that was written has left, at the line's speed: the kernel may not tell."""
        self._stuck = False
        self._revocable_at: float | None = None
        """When a frame was written that may not leave late; None once it has left."""
        self.opened = 0
        self.trouble: str | None = None

    def fileno(self) -> int | None:
        """The file descriptor to select on; None while the device is absent."""
        return None if self._transport is None else self._transport.fileno()

    @property
    def datagrams(self) -> bool:
        """Whether each read returns whole frames only, as UDP does."""
        return self._transport is not None and self._transport.datagrams

    def read(self, now: float) -> bytes:
        """Return what arrived, at most a few KiB. Opens an absent device when its next try is due."""
        self._now = now
        if self._transport is None:
            self._open(now)
        if self._transport is None:
            return b""
        try:
            self._transport.check(now)
            self._recall_late(now)
            data = self._transport.read()
        except OSError as error:
            self._handle_error(error, now)
            return b""
        if data:
            self._delay = FIRST_RETRY
            self.trouble = self.trouble if self._stuck else None
        return data

    def write(self, frame: bytes, now: float, *, revocable: bool = False) -> bool:
        """Write `frame`; False when the device did not take it. revocable: it may not leave later than
        1 s from now, and `recall` takes it back.
        """
        self._now = now
        if self._transport is None:
            return False
        try:
            taken = self._transport.write(frame)
        except OSError as error:
            self._handle_error(error, now)
            return False
        if taken and revocable:
            self._transport.note_revocable()
            self._revocable_at = now
        if taken:
            self._line_free_at = max(self._line_free_at, now) + len(frame) / self._transport.rate
        # A device takes some bytes even when nobody reads them: a write alone counts only after a while.
        if taken and now - self._opened_at >= (2 * STUCK_AFTER if self._stuck else LAST_RETRY):
            self._mark_working()
        return taken

    def idle(self, now: float) -> bool:
        """Whether nothing that was written waits in this computer, as far as that is known."""
        return now >= self._line_free_at and self._asked(lambda transport: transport.idle(), now)

    def has_room(self, now: float) -> bool:
        """Whether a frame may be written that an urgent one behind it would wait for: 0.1 s at most."""
        return now + ROOM >= self._line_free_at and self._asked(lambda transport: transport.has_room(), now)

    def recall(self) -> None:
        """Drop a revocable frame that may not have left yet, with all that waits before and behind it."""
        if self._transport is None or self._revocable_at is None:
            return
        self._revocable_at = None
        self._line_free_at = self._now
        try:
            self._transport.recall()
        except OSError as error:
            self._handle_error(error, self._now)

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Report that a frame of the last read was accepted; autopilot: our autopilot sent it."""
        if self._transport is not None:
            self._transport.note_accepted(now, autopilot=autopilot)

    def close(self) -> None:
        """Close the device. The next read opens it again."""
        if self._transport is not None:
            with contextlib.suppress(OSError):
                self._transport.close()
            self._transport = None

    def _open(self, now: float) -> None:
        if now < self._retry_at:
            return
        try:
            self._transport = self._opener()
            self.opened += 1
            self._opened_at = self._line_free_at = now
        except OSError as error:
            self._handle_error(error, now)

    def _recall_late(self, now: float) -> None:
        """Recall a revocable frame that may still wait 1 s after it was written."""
        if self._revocable_at is None or self._transport is None:
            return
        if self._transport.settled():
            self._revocable_at = None
        elif now - self._revocable_at >= STUCK_AFTER:
            self._revocable_at = None
            self._transport.recall()

    def _asked(self, question: Callable[[Transport], bool], now: float) -> bool:
        if self._transport is None:
            return False
        try:
            return question(self._transport)
        except OSError as error:
            self._handle_error(error, now)
            return False

    def _mark_working(self) -> None:
        self._delay = FIRST_RETRY
        self._stuck = False
        self.trouble = None

    def _handle_error(self, error: OSError, now: float) -> None:
        self.close()
        self._revocable_at = None
        self._stuck = isinstance(error, StuckError)
        self.trouble = error.strerror or str(error)
        if error.errno in _ABSENT:
            self._delay = FIRST_RETRY
            self._retry_at = now + FIRST_RETRY
            return
        self._retry_at = now + self._delay
        self._delay = min(LAST_RETRY, 2 * self._delay)
