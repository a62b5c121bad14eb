"""Runs jobs in the background. One that hangs delays nothing but the next one."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

log = logging.getLogger(__name__)

_LAST_JOB = 0.2
"""Seconds that the end may wait for the job under way."""


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
