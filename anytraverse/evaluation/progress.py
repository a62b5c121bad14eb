"""Shows the progress of a long command: a bar on a terminal, elsewhere lines."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

_LINES = 10
_WIDTH = 30
_PERIOD = 0.1
_BEAT = 1.0
_SILENT = 5.0
"""Seconds after which a line is written, or the bar is drawn, though no step was done."""


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Say on stderr what is done now, and every few seconds that it still is."""
    with Progress(0, what) as progress:
        progress.say(what)
        yield


class Progress:
    """Shows on a stream how many steps of `total` are done, and what time is left.

    On a terminal the bar is drawn at most ten times a second; elsewhere a line is written at each tenth. As a
    context manager it also shows every few seconds that it is alive while one step takes long.
    """

    def __init__(
        self,
        total: int,
        unit: str,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """total: 0 where it is not known. unit: what is counted, or what is done where nothing is."""
        self._total = total
        self._unit = unit
        self._stream = stream or sys.stderr
        self._clock = clock
        self._bar = self._stream.isatty()
        self._done = 0
        self._note = ""
        self._begun = clock()
        self._waited = 0.0
        self._waits = False
        self._shown = -_PERIOD
        self._lock = threading.RLock()
        self._over = threading.Event()

    def __enter__(self) -> Progress:
        threading.Thread(target=self._beats, name="progress", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.close()

    @property
    def elapsed(self) -> float:
        """Seconds since the start, without those in which a person was waited for."""
        return self._clock() - self._begun - self._waited

    def step(self, count: int = 1, note: str = "") -> None:
        """Count `count` more steps as done; `note` is shown behind the times."""
        with self._lock:
            before, self._done, self._note = self._done, self._done + count, note
            elapsed = self.elapsed
            if self._bar:
                if elapsed - self._shown >= _PERIOD:
                    self._show(elapsed)
            elif self._total and self._done * _LINES // self._total > before * _LINES // self._total:
                self._show(elapsed)

    def reach(self, done: int, note: str = "") -> None:
        """Count the steps up to `done` as done."""
        if done > self._done:
            self.step(done - self._done, note)

    def beat(self) -> None:
        """Show that it is alive where nothing was shown for some seconds."""
        with self._lock:
            if not self._waits and (elapsed := self.elapsed) - max(0.0, self._shown) >= _SILENT:
                self._show(elapsed)

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Show nothing, and count no time: a person is waited for."""
        with self._lock:
            self.close()
            self._waits, since = True, self._clock()
        try:
            yield
        finally:
            with self._lock:
                self._waits = False
                self._waited += self._clock() - since

    def say(self, line: str) -> None:
        """Write a line of its own above the bar."""
        with self._lock:
            self.close()
            self._write(f"{line}\n")

    def close(self) -> None:
        """Clear the bar."""
        with self._lock:
            if self._bar:
                self._write("\r\x1b[K")

    def _beats(self) -> None:
        while not self._over.wait(_BEAT):
            self.beat()

    def _show(self, elapsed: float) -> None:
        self._shown = elapsed
        text = f"{self._text(elapsed)}{self._note}"
        self._write(f"\r{self._gauge()}{text}\x1b[K" if self._bar else f"{text}\n")

    def _text(self, elapsed: float) -> str:
        if not self._total:
            return f"{f'{self._done} ' if self._done else ''}{self._unit}, {elapsed:.0f} s"
        text = f"{self._done}/{self._total} {self._unit}, {elapsed:.0f} s"
        if not self._done:
            return text
        return f"{text}, {elapsed / self._done * max(0, self._total - self._done):.0f} s left"

    def _gauge(self) -> str:
        if not self._total:
            return ""
        filled = min(_WIDTH, self._done * _WIDTH // self._total)
        return f"[{'#' * filled}{'-' * (_WIDTH - filled)}] "

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
