"""Pictures of the moments that a person may want to look at later: calls, answers, holds."""

from __future__ import annotations

import contextlib
import logging
import re
from pathlib import Path

from companion.durable import write_whole

log = logging.getLogger(__name__)


class Album:
    """A folder of at most `keep` pictures; the oldest goes. A picture that cannot be written is no fault."""

    def __init__(self, folder: Path, keep: int) -> None:
        self._folder = folder
        self._keep = keep
        self._count = max(map(_number, self._pictures()), default=0)
        for torn in folder.glob(".[0-9]*.part"):
            with contextlib.suppress(OSError):
                torn.unlink()

    @property
    def wanted(self) -> bool:
        """Whether pictures are kept at all."""
        return self._keep > 0

    def store(self, title: str, jpeg: bytes) -> Path | None:
        """Write a picture; where it lies, or None when there is none or it could not be written."""
        if not self.wanted or not jpeg:
            return None
        self._count += 1
        slug = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40]
        path = self._folder / f"{self._count:05d}-{slug}.jpg"
        try:
            write_whole(path, jpeg)
            for old in self._pictures()[: -self._keep]:
                old.unlink(missing_ok=True)
        except OSError as error:
            log.warning("no picture of %s: %r", title, error)
            return None
        return path

    def _pictures(self) -> list[Path]:
        """The oldest first, also beyond 99,999."""
        return sorted((path for path in self._folder.glob("[0-9]*-*.jpg") if _number(path)), key=_number)


def _number(path: Path) -> int:
    number = path.name.partition("-")[0]
    return int(number) if number.isdecimal() else 0
