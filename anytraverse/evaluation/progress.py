"""Shows the progress of a long command: a bar on a terminal, elsewhere ten lines."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

_LINES = 10
_WIDTH = 30
_PERIOD = 0.1


class Progress:
    """Shows on a stream how many steps of `total` are done.

    On a terminal the bar is drawn at most ten times a second; elsewhere ten lines are written in all.
    """

    def __init__(
        self,
        total: int,
        unit: str,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total = max(1, total)
        self._unit = unit
        self._stream = stream or sys.stderr
        self._clock = clock
        self._bar = self._stream.isatty()
        self._done = 0
        self._begun = clock()
        self._drawn = -_PERIOD

    def step(self, count: int = 1, note: str = "") -> None:
        """Count `count` more steps as done; `note` is shown behind the times."""
        before, self._done = self._done, self._done + count
        elapsed = self._clock() - self._begun
        if self._bar:
            if elapsed - self._drawn >= _PERIOD:
                self._drawn = elapsed
                self._write(f"\r{self._gauge()} {self._text(elapsed)}{note}\x1b[K")
        elif self._done * _LINES // self._total > before * _LINES // self._total:
            self._write(f"{self._text(elapsed)}{note}\n")

    def say(self, line: str) -> None:
        """Write a line of its own above the bar."""
        self.close()
        self._write(f"{line}\n")

    def _text(self, elapsed: float) -> str:
        left = elapsed / self._done * (self._total - self._done)
        return f"{self._done}/{self._total} {self._unit}, {elapsed:.0f} s, {left:.0f} s left"

    def _gauge(self) -> str:
        filled = min(_WIDTH, self._done * _WIDTH // self._total)
        return f"[{'#' * filled}{'-' * (_WIDTH - filled)}]"

    def close(self) -> None:
        """Clear the bar."""
        if self._bar:
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
