"""Runs what takes seconds beside the page: one job of a kind at a time, each with a deadline."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from companion.pages.requests import RequestError

log = logging.getLogger(__name__)


class Job(NamedTuple):
    """A kind of job. run: takes the request, returns JSON values, or raises RequestError. limit: seconds."""

    run: Callable[[Mapping[str, Any]], Any]
    limit: float


class _Running:
    def __init__(self, job: Job, told: Mapping[str, Any]) -> None:
        self._began = time.monotonic()
        self._job = job
        self._told = told
        self._ended: dict[str, Any] | None = None
        self.thread = threading.Thread(target=self._run, name="job", daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self._ended = {"state": "done", "result": self._job.run(self._told)}
        except RequestError as error:
            self._ended = {"state": "failed", "problem": str(error)}
        except Exception as error:  # a driver may raise anything: the page goes on
            log.warning("a job failed", exc_info=True)
            self._ended = {"state": "failed", "problem": f"{type(error).__name__}: {error}"[:300]}

    def document(self) -> Mapping[str, Any]:
        seconds = time.monotonic() - self._began
        if self._ended is not None:
            return self._ended
        if seconds > self._job.limit:
            late = (
                f"it did not end within {self._job.limit:.0f} s: try again, or start `companion setup` anew"
            )
            return {"state": "failed", "problem": late}
        return {"state": "running", "seconds": round(seconds, 1)}


class Jobs:
    """Holds the newest job of each kind."""

    def __init__(self, jobs: Mapping[str, Job]) -> None:
        self._jobs = jobs
        self._newest: dict[str, _Running] = {}

    def start(self, name: str, told: Mapping[str, Any]) -> Mapping[str, Any]:
        """Start a job. Raises RequestError for an unknown one, and while the one before runs."""
        if name not in self._jobs:
            raise RequestError(f"there is no job {name[:40]}")
        before = self._newest.get(name)
        if before is not None and before.thread.is_alive():
            raise RequestError("it still runs: wait a moment")
        self._newest[name] = _Running(self._jobs[name], told)
        return self._newest[name].document()

    def document(self, name: str) -> Mapping[str, Any]:
        """Return state, and result or problem, of the newest job of a kind."""
        found = self._newest.get(name)
        return {"state": "idle"} if found is None else found.document()
