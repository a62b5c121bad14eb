"""Writes everything to the disk in one thread, so that a slow disk does not stall the main loop.

The journal goes first, in one transaction for all that waits; then files and log lines in the order in which
they came. Handing over work never blocks.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from companion.storage import Batch, Journal, JournalError
from companion.storage.batch import MAX_ROWS

log = logging.getLogger(__name__)

SLOW = 2.0
"""Seconds after which a write counts as failed for its caller. It is finished all the same."""
PATIENCE = 0.5
"""Seconds before a failed journal write is tried again."""
BOUNDS = {"status": 1, "picture": 8, "record": 32, "log": 1000}
"""Kind -> jobs that may wait. Beyond that the oldest job of the kind is dropped and counted."""
_JOURNAL = "journal"
_SLOW_AGAIN = 10.0
"""Seconds after a slow write for which the disk still counts as slow."""
_LAST_JOB = 0.2
"""Seconds that `close` gives the present job when not everything can be written."""


class _Job(NamedTuple):
    kind: str
    write: Callable[[], object]


class Writer:
    """Owns the journal and the writer thread. Before it is entered, only `run_once` writes.

    committed: the newest ticket that is on disk. failed: the newest ticket that could not be written.
    errors: failed writes by kind. dropped: jobs without room by kind.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._changed = threading.Condition()
        self._batch = Batch()
        self._jobs: deque[_Job] = deque()
        self._ticket = self.committed = self.failed = 0
        self._tried_at = float("-inf")
        self._waits_since: float | None = None
        """Monotonic seconds since which something waits for the journal or is being written to it."""
        self._slow_until = float("-inf")
        self._tidy_due = False
        self._jobs_first = 0
        """Jobs that waited during the last commit. They run before the next one, so that each gets a turn."""
        self._failing_kinds: set[str] = set()
        self.errors: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self._stop = False
        self._idle = True
        self._drain_failed = False
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)

    def __enter__(self) -> Writer:
        """Start the writer thread."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def failing(self) -> bool:
        """Whether the last write to the journal failed, or the disk is slow."""
        since, now = self._waits_since, time.monotonic()
        slow = now < self._slow_until or (since is not None and now - since > SLOW)
        return _JOURNAL in self._failing_kinds or slow

    def figures(self) -> dict[str, Any]:
        """Return how writing goes, for the status file: JSON values."""
        return {"failing": self.failing, "errors": dict(self.errors), "dropped": dict(self.dropped)}

    def queue_batch(self, batch: Batch) -> int:
        """Queue a batch for the next commit, and return its ticket: compare it with `committed`, `failed`.

        When more than `MAX_ROWS` rows wait, rows are dropped, so that all earlier tickets count as failed.
        """
        with self._changed:
            if len(self._batch.rows) + len(batch.rows) > MAX_ROWS:
                self.dropped[_JOURNAL] += len(self._batch.rows) + len(batch.rows) - MAX_ROWS
                self.failed = self._ticket
            self._batch = self._batch.merged_with(batch)
            self._waits_since = self._waits_since or time.monotonic()
            self._ticket += 1
            self._changed.notify_all()
            return self._ticket

    def queue_job(self, kind: str, job: Callable[[], object]) -> None:
        """Queue a job that writes a file. kind: a key of `BOUNDS`. Of errors in a row the first is logged."""
        with self._changed:
            waiting = [number for number, one in enumerate(self._jobs) if one.kind == kind]
            if len(waiting) >= BOUNDS[kind]:
                del self._jobs[waiting[0]]
                self.dropped[kind] += kind != "status"  # a newer status replaces the older one
            self._jobs.append(_Job(kind, job))
            self._changed.notify_all()

    def run_once(self) -> bool:
        """Do the most urgent work that is due. False when there is none."""
        if self._tidy_due:
            self._tidy_due = False
            self._succeeds("tidying", self._journal.tidy)
            return True
        with self._changed:
            batch, ticket = Batch() if self._jobs_first else self._due(), self._ticket
            if batch:
                self._batch, self._jobs_first = Batch(), len(self._jobs)
            job = self._jobs.popleft() if not batch and self._jobs else None
            self._jobs_first = min(len(self._jobs), max(0, self._jobs_first - (job is not None)))
        if batch:
            self._commit(batch, ticket)
        elif job is not None:
            self._succeeds(job.kind, job.write)
        return bool(batch) or job is not None

    def drain(self, limit: float = SLOW) -> bool:
        """Wait until everything is written. False when `limit` seconds are not enough.

        After one such failure it does not wait again, so that leaving does not take `limit` several times.
        """
        if self._thread.ident is None:
            while self.run_once():
                pass
            return not self._batch
        with self._changed:
            limit = 0.0 if self._drain_failed else limit
            self._drain_failed = not self._changed.wait_for(self._all_written, limit)
            return not self._drain_failed

    def close(self) -> None:
        """Write what waits and close the journal, in `SLOW` seconds at most even if the disk hangs."""
        until = time.monotonic() + SLOW
        done = self.drain()
        if not done:
            log.warning("the disk fails or hangs: what waits to be written is lost; check the disk")
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        if self._thread.ident is None:
            self._journal.close()
        else:
            self._thread.join(max(_LAST_JOB, until - time.monotonic()) if done else _LAST_JOB)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._idle = True
                self._changed.notify_all()
                self._changed.wait_for(self._has_work, PATIENCE)
                if self._stop:
                    break
                self._idle = False
            while not self._stop and self.run_once():
                pass
        self._journal.close()

    def _all_written(self) -> bool:
        return self._idle and not (self._jobs or self._tidy_due or self._batch)

    def _has_work(self) -> bool:
        return bool(self._stop or self._jobs or self._tidy_due or self._due())

    def _due(self) -> Batch:
        """Return what waits for the journal; an empty batch while it is too early for another try."""
        again = _JOURNAL in self._failing_kinds and time.monotonic() - self._tried_at < PATIENCE
        return Batch() if again else self._batch

    def _commit(self, batch: Batch, ticket: int) -> None:
        """Write a batch to the journal. What could not be written waits for the next try."""
        began = self._tried_at = time.monotonic()
        left = self._write_to_journal(batch)
        ended = time.monotonic()
        if ended - began > SLOW:
            self._slow_until = ended + _SLOW_AGAIN
        with self._changed:
            self._batch = left.merged_with(self._batch)
            self._waits_since = ended if self._batch else None
            # A frame that does not fit fails no ticket: what was acknowledged is on disk without it.
            if left.memory or left.state or left.rows:
                self.failed = max(self.failed, ticket)
            else:
                self.committed = max(self.committed, ticket)
                self._tidy_due = True

    def _write_to_journal(self, batch: Batch) -> Batch:
        """Write as much of a batch as fits, and return the rest; an empty batch when all is on disk.

        On a disk that is too full for the frame, all but the frame is written.
        """
        rest = replace(batch, frame=None)
        if self._succeeds(_JOURNAL, lambda: self._journal.commit(batch)):
            return Batch()
        if batch.frame is None or not rest:
            return batch
        try:
            self._journal.commit(rest)
        except Exception:  # the first try has logged it
            return batch
        return Batch(frame=batch.frame)

    def _succeeds(self, kind: str, write: Callable[[], object]) -> bool:
        """Run a write, and return whether it succeeded. An unexpected error is logged with its traceback."""
        try:
            write()
        except Exception as error:
            self.errors[kind] += 1
            if kind not in self._failing_kinds:
                self._failing_kinds.add(kind)
                foreseen = isinstance(error, (OSError, JournalError))
                log.error("%s cannot be written: %s", kind, error, exc_info=not foreseen)
            return False
        if kind in self._failing_kinds:
            self._failing_kinds.discard(kind)
            log.info("%s is written again", kind)
        return True
