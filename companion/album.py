"""Pictures of the moments that a person may want to look at later: calls, answers, holds."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from companion.durable import write_whole


class Album:
    """A folder of at most `keep` pictures; the oldest goes."""

    def __init__(self, folder: Path, keep: int) -> None:
        self._folder = folder
        self._keep = keep
        self._count = max(map(_number, self._pictures()), default=0)
        for torn in folder.glob(".[0-9]*.part"):
            with contextlib.suppress(OSError):
                torn.unlink()

    @property
    def wanted(self) -> bool:
        """Whether it keeps any picture at all."""
        return self._keep > 0

    def add(self, picture: bytes, title: str) -> Path:
        """Store a JPEG; where it lies. Raises OSError."""
        self._count += 1
        slug = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40]
        path = self._folder / f"{self._count:05d}-{slug}.jpg"
        write_whole(path, picture)
        for old in self._pictures()[: -self._keep]:
            old.unlink(missing_ok=True)
        return path

    def _pictures(self) -> list[Path]:
        """The oldest first, also beyond 99,999."""
        return sorted((path for path in self._folder.glob("[0-9]*-*.jpg") if _number(path)), key=_number)


def _number(path: Path) -> int:
    number = path.name.partition("-")[0]
    return int(number) if number.isdecimal() else 0
