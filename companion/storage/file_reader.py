"""The one thread that reads served files, so that a disk that hangs delays nobody but who asked."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

from companion.storage.served_tree import FileError, LaterError

_T = TypeVar("_T")

PATIENCE = 2.0
"""Seconds after which a read counts as failed for who asked."""
_LAST_READ = 0.2
"""Seconds for the read in hand to end."""
MOST = 4
"""Reads that may wait or be there for who asked, at most `MAX_SIZE` bytes each."""


@dataclass
class _Read:
    job: Callable[[], Any]
    asked_at: float
    done: bool = False
    found: Any = None
    error: FileError | None = None


class Reader:
    """Unless it is entered, what is asked for is read at once, in the caller's thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._reads: dict[Hashable, _Read] = {}
        self._stop = False
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def __enter__(self) -> Reader:
        """Read from now on, in a thread, until left."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._stop = True
            self._changed.notify_all()
        self._thread.join(_LAST_READ)

    def read(self, key: Hashable, job: Callable[[], _T]) -> _T:
        """What `job` finds; it may raise FileError, and nothing else. key: what it reads.

        Never waits. Raises LaterError while it is being read: ask again. Raises FileError where the disk
        takes over 2 s, or too much waits for it.
        """
        if self._thread.ident is None:
            return job()
        now = time.monotonic()
        with self._changed:
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
            except Exception as error:  # as little as another provider's mistake may it cost the others
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
