"""Lines from standard input, without waiting for them."""

from __future__ import annotations

import os
import select
import stat
from typing import TextIO

MAX_WAITING = 65536


class Keyboard:
    """Reads a terminal, a pipe or a file. `ended` is true after its end, and never for /dev/null: a program
    in the background has nobody who types, and goes on."""

    def __init__(self, descriptor: int | None) -> None:
        self.ended = False
        self._descriptor = descriptor
        self._waiting = b""

    @classmethod
    def of(cls, stream: TextIO | None) -> Keyboard:
        """The stream's descriptor, unless nobody can type there."""
        try:
            descriptor = -1 if stream is None else stream.fileno()
            mode = os.fstat(descriptor).st_mode
        except (OSError, ValueError):
            return cls(None)
        return cls(None if stat.S_ISCHR(mode) and not os.isatty(descriptor) else descriptor)

    def descriptors(self) -> list[int]:
        """To wait on."""
        return [] if self._descriptor is None or self.ended else [self._descriptor]

    def lines(self) -> list[str]:
        """The lines that are complete; at the end also an unfinished one."""
        if not self.descriptors() or not select.select(self.descriptors(), [], [], 0)[0]:
            return []
        assert self._descriptor is not None
        try:
            read = os.read(self._descriptor, 4096)
        except OSError:
            read = b""
        self.ended = not read
        *complete, self._waiting = (self._waiting + read).split(b"\n")
        if self.ended or len(self._waiting) > MAX_WAITING:
            complete.append(self._waiting)
            self._waiting = b""
        return [line.decode(errors="replace") for line in complete]
