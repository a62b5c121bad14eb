"""Reads served files in a thread, so that a disk that hangs does not stall the main loop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

from companion.storage.served_tree import FileError, LaterError

_T = TypeVar("_T")

PATIENCE = 2.0
"""Seconds after which a read counts as failed."""
_LAST_READ = 0.2
"""Seconds that the end of the thread may take for the read under way."""
MOST = 4
"""Reads that may wait, or be finished and not yet fetched, at most `MAX_SIZE` bytes each."""


@dataclass
class _Read:
    job: Callable[[], Any]
    asked_at: float
    done: bool = False
    found: Any = None
    error: FileError | None = None


class FileReader:
    """Runs reading jobs in a thread. Before it is entered, it runs them at once in the caller's thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._reads: dict[Hashable, _Read] = {}
        self._stop = False
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def __enter__(self) -> FileReader:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        self._thread.join(_LAST_READ)

    def read(self, key: Hashable, job: Callable[[], _T]) -> _T:
        """Return the result of `job`, which may raise FileError. key: names what the job reads.

        Never blocks. Raises LaterError until the job is done: call again with the same key. Raises FileError
        when the disk takes longer than `PATIENCE`, or too many reads wait.
        """
        if self._thread.ident is None:
            return job()
        now = time.monotonic()
        with self._changed:
            # A result that its caller has not fetched for so long is not wanted any more.
            self._reads = {
                one: read for one, read in self._reads.items() if now - read.asked_at < 2 * PATIENCE
            }
            if key not in self._reads and len(self._reads) >= MOST:
                raise FileError("too much waits for the disk: ask again later")
            read = self._reads.setdefault(key, _Read(job, now))
            self._changed.notify_all()
            if not read.done and now - read.asked_at < PATIENCE:
                raise LaterError("it is being read")
            del self._reads[key]
        if read.error is not None or not read.done:
            raise read.error or FileError("the disk hangs")
        found: _T = read.found
        return found

    def _run(self) -> None:
        while read := self._next():
            try:
                read.found = read.job()
            except FileError as error:
                read.error = error
            except Exception as error:  # an error in one job must not end the thread for the others
                read.error = FileError(f"{type(error).__name__}: {error}")
            read.done = True

    def _next(self) -> _Read | None:
        with self._changed:
            while not self._stop:
                for read in self._reads.values():
                    if not read.done:
                        return read
                self._changed.wait()
        return None
