"""Deletes recordings that somebody asked to delete, never the one that is being written."""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

from anytraverse.regular_file import open_regular
from companion.config import Config
from companion.observers.recording.ring import FOLDER, name_of
from companion.wire.ids import Result

log = logging.getLogger(__name__)

MOST_WAITING = 8
Tell = Callable[[Result, str], None]


class RecordingDeleter:
    """Deletes one recording after the other. The main loop calls `poll` in every turn; nothing waits."""

    def __init__(self, config: Config) -> None:
        self._folder = Path(os.path.abspath(config.journal.path), FOLDER)
        self._asked: deque[tuple[int, Tell]] = deque()
        self._thread: threading.Thread | None = None
        self._became: tuple[Result, str] | None = None

    def ask(self, number: int, tell: Tell) -> None:
        """Have the recording of a number deleted. tell: told what became of it, by `poll`."""
        if len(self._asked) >= MOST_WAITING:
            tell(Result.REFUSED, f"{MOST_WAITING} others wait for the disk: ask again later")
        else:
            self._asked.append((number, tell))

    def poll(self) -> None:
        """Tell what became of the first one, and go on with the next."""
        if self._thread is not None:
            if self._thread.is_alive():
                return
            self._thread = None
            _, tell = self._asked.popleft()
            tell(*(self._became or (Result.REFUSED, "it cannot be deleted: see the log")))
        if self._asked:
            self._became = None
            self._thread = threading.Thread(
                target=self._delete, args=[self._asked[0][0]], name="deleting", daemon=True
            )
            self._thread.start()

    def close(self) -> None:
        """Leave what is asked for undone."""
        self._asked.clear()

    def _delete(self, number: int) -> None:
        try:
            self._became = delete(self._folder, number)
        except OSError as error:
            self._became = Result.REFUSED, f"the disk: {(error.strerror or str(error)).lower()}"


def delete(folder: Path, number: int) -> tuple[Result, str]:
    """Delete the recording of a number. Returns what a requester is told. Raises OSError."""
    from companion.observers.recording.reading import lock

    for event in (False, True):
        path = folder / name_of(number, event=event)
        try:
            descriptor = open_regular(path, follow=False)
        except FileNotFoundError:
            continue
        with os.fdopen(descriptor, "rb") as file:
            try:
                # Its writer has it locked, but for the moment in which it is made.
                if not os.fstat(descriptor).st_size:
                    raise BlockingIOError
                lock(file)
            except BlockingIOError:
                return Result.REFUSED, "it is being written: delete it when the next one has begun"
            path.unlink()
        log.info("%s was deleted on request", path.name)
        return Result.APPLIED, "it is deleted"
    return Result.APPLIED, "it is gone already"
