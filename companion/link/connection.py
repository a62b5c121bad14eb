"""The device, opened again when it goes away."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Callable

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
"""There is nothing to open: to look for it often costs next to nothing, and harms nobody."""


class Connection:
    """A transport that may be absent: looked for every 0.5 s, so that it is back as soon as it is there.

    One that is there and breaks is tried again after 0.5 s, twice that, ... 8 s: to open some resets them. It
    is well again when something is read, or taken 8 s after it was opened. Raises nothing.
    """

    def __init__(self, opener: Callable[[], Transport], now: float) -> None:
        self._opener = opener
        self._transport: Transport | None = None
        self._retry_at = now
        self._delay = FIRST_RETRY
        self._opened_at = now
        self.opened = 0
        self.trouble: str | None = None

    def fileno(self) -> int | None:
        """For select; None while the device is absent."""
        return None if self._transport is None else self._transport.fileno()

    @property
    def datagrams(self) -> bool:
        """Whether what is read holds whole frames only."""
        return self._transport is not None and self._transport.datagrams

    def read(self, now: float) -> bytes:
        """What arrived; opens the device when it is time."""
        if self._transport is None:
            self._open(now)
        if self._transport is None:
            return b""
        try:
            data = self._transport.read()
        except OSError as error:
            self._handle_error(error, now)
            return b""
        if data:
            self._mark_working()
        return data

    def write(self, frame: bytes, now: float) -> bool:
        """Whether the device took `frame` whole."""
        if self._transport is None:
            return False
        try:
            taken = self._transport.write(frame)
        except OSError as error:
            self._handle_error(error, now)
            return False
        if taken and now - self._opened_at >= LAST_RETRY:
            self._mark_working()
        return taken

    def believe(self, now: float, *, autopilot: bool) -> None:
        """A frame in what was read last was believed; autopilot: it was our autopilot's."""
        if self._transport is not None:
            self._transport.believe(now, autopilot=autopilot)

    def close(self) -> None:
        """Give the device back, until the next read."""
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
            self._opened_at = now
        except OSError as error:
            self._handle_error(error, now)

    def _mark_working(self) -> None:
        self._delay = FIRST_RETRY
        self.trouble = None

    def _handle_error(self, error: OSError, now: float) -> None:
        self.close()
        self.trouble = error.strerror or str(error)
        if error.errno in _ABSENT:
            self._delay = FIRST_RETRY
            self._retry_at = now + FIRST_RETRY
            return
        self._retry_at = now + self._delay
        self._delay = min(LAST_RETRY, 2 * self._delay)
