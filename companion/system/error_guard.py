"""Catches unexpected errors, logs them and reports them to the operator."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

_REPORT_INTERVAL = 10.0


class FatalError(Exception):
    """An error that is never survived: what decides is not known to be right any more."""


class ErrorGuard:
    """Counts errors, and logs and reports each kind at most once in 10 s.

    Use it only around work whose loss is noticed elsewhere. A frame that is lost here becomes a fault, since
    no fresh frame follows; a lost answer is sent again by its sender. An error of the supervision itself must
    end the daemon, so that the service manager starts it again.
    """

    def __init__(self, report: Callable[[float], None]) -> None:
        """report: sends a text to the operator; it gets the time in monotonic seconds."""
        self._report = report
        self._reported_at: dict[str, float] = {}
        self.count = 0

    @contextmanager
    def survived(self, what: str, now: float) -> Iterator[None]:
        """Catch any exception of the block but FatalError. `what` names the work in the log, and limits its
        rate.
        """
        try:
            yield
        except FatalError:
            raise
        except Exception:
            self.count += 1
            if now - self._reported_at.get(what, float("-inf")) >= _REPORT_INTERVAL:
                self._reported_at[what] = now
                log.exception("%s failed", what)
                self._report(now)
