"""Keeps a copy of the journal beside it, from which a damaged one is recovered."""

from __future__ import annotations

import logging
import shutil
import time
from contextlib import suppress
from pathlib import Path

from companion.storage.database import Database, JournalError

_log = logging.getLogger(__name__)

AGE = 86_400.0
"""Seconds after which the copy is made anew."""
_LOOKED_EVERY = 3600.0
LEAST_FREE = 64 << 20
"""Bytes that stay free on the disk beside the copy: for the journal itself."""


class DailyCopy:
    """One file, which is replaced as a whole. The thread that writes the journal makes it.

    A rover may boot without a clock: a copy from the future counts as old, and without any clock one is made
    after a day of running.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._outdated = False
        self._look_at = float("-inf")

    def outdated(self) -> None:
        """Have the copy replaced by the next `keep`: what was forgotten must not come back from it."""
        self._outdated, self._look_at = True, float("-inf")

    def date(self) -> str:
        """Return when the copy was made, local time, for a person."""
        try:
            return time.strftime("%Y-%m-%d %H:%M", time.localtime(self.path.stat().st_mtime))
        except OSError:
            return "an unknown time"

    def keep(self, database: Database) -> None:
        """Copy the journal where that is due and the disk has room. Raises JournalError."""
        now = time.monotonic()
        if now < self._look_at:
            return
        self._look_at = now + _LOOKED_EVERY
        try:
            if self._outdated:
                self.path.unlink(missing_ok=True)
            elif not self._is_old():
                return
            free = shutil.disk_usage(self.path.parent).free
            if free < database.size + LEAST_FREE:
                _log.warning("the journal is not copied: %d MB are free on its disk", free // 1_000_000)
                return
            database.copy_to(self.path)
        except OSError as error:
            raise JournalError(f"{self.path} cannot be written ({error.strerror}): check the disk") from error
        self._outdated = False

    def _is_old(self) -> bool:
        with suppress(FileNotFoundError):
            return not 0.0 <= time.time() - self.path.stat().st_mtime < AGE
        return True
