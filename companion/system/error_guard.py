"""Survives unexpected errors: logs them and reports them to the operator. Runs jobs in the background."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

_REPORT_INTERVAL = 10.0
_LAST_JOB = 0.2
"""Seconds that the end may wait for the job under way."""


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


class BackgroundJob:
    """Runs one job at a time in a thread. For work that is done again anyway: sensors and checks."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._failed = False

    def __enter__(self) -> BackgroundJob:
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread is not None:
            self._thread.join(_LAST_JOB)

    def run(self, job: Callable[[], object]) -> bool:
        """Start a job; never blocks. False while the one before still runs: then this one is left out."""
        if self._thread is not None and self._thread.is_alive():
            return False
        self._thread = threading.Thread(target=self._survive, args=[job], name="background", daemon=True)
        self._thread.start()
        return True

    def _survive(self, job: Callable[[], object]) -> None:
        try:
            job()
        except Exception:
            if not self._failed:
                log.exception("the computer cannot be measured or checked")
            self._failed = True
