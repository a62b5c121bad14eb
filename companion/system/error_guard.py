"""Errors that nobody foresaw: the daemon survives them, and they are seen."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

_SAID_AGAIN = 10.0


class ErrorGuard:
    """Logs an error with its traceback and has it said, each kind at most once in 10 s, and counts it.

    Only around what may fail without leaving the vehicle unwatched: a frame whose judgement is lost here ends
    in a fault by itself, an answer goes unanswered. An error of the supervision itself must end the daemon.
    """

    def __init__(self, say: Callable[[float], None]) -> None:
        """say: tells the operator; gets monotonic seconds."""
        self._say = say
        self._said_at: dict[str, float] = {}
        self.count = 0

    @contextmanager
    def survived(self, what: str, now: float) -> Iterator[None]:
        """Go on after any error of `what`."""
        try:
            yield
        except Exception:
            self.count += 1
            if now - self._said_at.get(what, float("-inf")) >= _SAID_AGAIN:
                self._said_at[what] = now
                log.exception("%s failed", what)
                self._say(now)
