"""The one thread that writes to the disk, so that a slow one delays nobody else.

What is most urgent goes first: the journal, in one transaction for all that waits, then files and log lines
in the order in which they came. Whoever hands something over never waits.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from companion.storage import Batch, Journal, JournalError
from companion.storage.batch import MAX_ROWS

log = logging.getLogger(__name__)

SLOW = 2.0
"""Seconds after which a write counts as failed for who waits for it; it is finished all the same."""
PATIENCE = 0.5
"""Seconds before what could not be written is tried again."""
BOUNDS = {"status": 1, "picture": 8, "record": 32, "log": 1000}
"""Jobs of a kind that may wait; beyond, the oldest of that kind goes, and is counted."""
_JOURNAL = "journal"
_SLOW_AGAIN = 10.0
"""Seconds after a slow write in which the next one is expected to be slow, too."""
_LAST_JOB = 0.2
"""Seconds for the job in hand to end, where not all can be written."""


class _Job(NamedTuple):
    kind: str
    write: Callable[[], object]


class Writer:
    """Owns the journal. committed, failed: the newest ticket that is on disk, or was tried in
    vain. errors, dropped: how many writes failed and how many jobs found no room, by kind.

    Unless it is entered nothing is written but by `run_once`.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._changed = threading.Condition()
        self._batch = Batch()
        self._jobs: deque[_Job] = deque()
        self._ticket = self.committed = self.failed = 0
        self._tried_at = float("-inf")
        self._waits_since: float | None = None
        """Since when something waits for the journal, or is written there."""
        self._slow_until = float("-inf")
        self._untidy = False
        self._jobs_first = 0
        """Jobs that waited during the last commit: the next one lets them go first."""
        self._troubled: set[str] = set()
        self.errors: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self._stop = False
        self._idle = True
        self._left_behind = False
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)

    def __enter__(self) -> Writer:
        """Write from now on, in a thread, until left."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def failing(self) -> bool:
        """Whether what must survive could not be written at the last try, or takes too long."""
        since, now = self._waits_since, time.monotonic()
        slow = now < self._slow_until or (since is not None and now - since > SLOW)
        return _JOURNAL in self._troubled or slow

    def keep(self, batch: Batch) -> int:
        """Have it committed, with all else that waits; its ticket.

        Where more rows wait than there is room for, whatever waits counts as failed.
        """
        with self._changed:
            if len(self._batch.rows) + len(batch.rows) > MAX_ROWS:
                self.dropped[_JOURNAL] += len(self._batch.rows) + len(batch.rows) - MAX_ROWS
                self.failed = self._ticket
            self._batch = self._batch.then(batch)
            self._waits_since = self._waits_since or time.monotonic()
            self._ticket += 1
            self._changed.notify_all()
            return self._ticket

    def write(self, kind: str, job: Callable[[], object]) -> None:
        """Have a file written by `job`, of a kind in `BOUNDS`. An error of it is logged once in a row."""
        with self._changed:
            waiting = [number for number, one in enumerate(self._jobs) if one.kind == kind]
            if len(waiting) >= BOUNDS[kind]:
                del self._jobs[waiting[0]]
                self.dropped[kind] += kind != "status"
            self._jobs.append(_Job(kind, job))
            self._changed.notify_all()

    def run_once(self) -> bool:
        """Do the most urgent that is due; False when nothing is. Jobs are not kept waiting for ever."""
        if self._untidy:
            self._untidy = False
            self._survive("tidying", self._journal.tidy)
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
            self._survive(job.kind, job.write)
        return bool(batch) or job is not None

    def drain(self, limit: float = SLOW) -> bool:
        """Wait until all is written; False when `limit` seconds are, or were, not enough."""
        if self._thread.ident is None:
            while self.run_once():
                pass
            return not self._batch
        with self._changed:
            limit = 0.0 if self._left_behind else limit
            self._left_behind = not self._changed.wait_for(self._all_written, limit)
            return not self._left_behind

    def close(self) -> None:
        """Write what waits and give the journal back, unless the disk hangs: `SLOW` seconds at most."""
        until = time.monotonic() + SLOW
        done = self.drain()
        if not done:
            log.warning("the disk fails or hangs: what waits to be written is lost")
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
        return self._idle and not (self._jobs or self._untidy or self._batch)

    def _has_work(self) -> bool:
        return bool(self._stop or self._jobs or self._untidy or self._due())

    def _due(self) -> Batch:
        """What waits for the journal, empty while it is too early to try again."""
        again = _JOURNAL in self._troubled and time.monotonic() - self._tried_at < PATIENCE
        return Batch() if again else self._batch

    def _commit(self, batch: Batch, ticket: int) -> None:
        """On a disk that is too full for the frame, the rest of it is kept."""
        began = self._tried_at = time.monotonic()
        left = self._journal_takes(batch)
        ended = time.monotonic()
        if ended - began > SLOW:
            self._slow_until = ended + _SLOW_AGAIN
        with self._changed:
            self._batch = left.then(self._batch)
            self._waits_since = ended if self._batch else None
            if left.memory or left.state or left.rows:
                self.failed = max(self.failed, ticket)
            else:
                self.committed = max(self.committed, ticket)
                self._untidy = True

    def _journal_takes(self, batch: Batch) -> Batch:
        """What is left of it, empty when all is on disk."""
        rest = replace(batch, frame=None)
        if self._survive(_JOURNAL, lambda: self._journal.commit(batch)):
            return Batch()
        if batch.frame is None or not rest:
            return batch
        try:
            self._journal.commit(rest)
        except Exception:  # told just now
            return batch
        return Batch(frame=batch.frame)

    def _survive(self, kind: str, write: Callable[[], object]) -> bool:
        """Whether it was written. What fails in a way that nobody foresaw is told with its traceback."""
        try:
            write()
        except Exception as error:
            self.errors[kind] += 1
            if kind not in self._troubled:
                self._troubled.add(kind)
                foreseen = isinstance(error, (OSError, JournalError))
                log.error("%s cannot be written: %s", kind, error, exc_info=not foreseen)
            return False
        if kind in self._troubled:
            self._troubled.discard(kind)
            log.info("%s is written again", kind)
        return True
