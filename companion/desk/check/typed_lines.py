"""Reads lines of a terminal or a pipe with a time limit, so that a camera is read while a person walks."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time

_LONGEST = 1000
"""Bytes of a line."""
_POLL = 0.5
"""Seconds until a Ctrl-C counts that another thread of this process received."""


class TypedLines:
    """Reads lines of a file descriptor, by default of standard input. Raises EOFError at its end."""

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._typed = b""

    def forget(self) -> None:
        """Drop what was typed before it was asked for: a second Enter must not measure the next mark."""
        if os.isatty(self._descriptor):
            self._typed = b""
            with contextlib.suppress(termios.error):
                termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def line(self, seconds: float) -> str | None:
        """Return the next line without its end, None where none is typed within so many seconds."""
        until = time.monotonic() + seconds
        while b"\n" not in self._typed:
            left = max(0.0, until - time.monotonic())
            if not select.select([self._descriptor], [], [], min(left, _POLL))[0]:
                if left <= _POLL:
                    return None
                continue
            read = os.read(self._descriptor, _LONGEST)
            if not read:
                raise EOFError
            self._typed += read
            if b"\n" not in self._typed:
                self._typed = self._typed[-_LONGEST:]
        line, _, self._typed = self._typed.partition(b"\n")
        return line.decode(errors="replace").strip()
