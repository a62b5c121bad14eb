"""The companion's own log as a file, bounded: the ground may read it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import RotatingFileHandler
from pathlib import Path

log = logging.getLogger(__name__)

FOLDER = "logs"
NAME = "companion.log"
"""And the one before it, companion.log.1."""
LONGEST = 256 * 1024
"""Bytes of each of the two."""


class _Quiet(RotatingFileHandler):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """A full disk costs lines of this file; they are on stderr."""


@contextmanager
def logbook(folder: Path) -> Iterator[None]:
    """Whatever is logged meanwhile is in `folder`/logs too, as far as that can be written."""
    root = logging.getLogger()
    try:
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
        handler = _Quiet(folder / FOLDER / NAME, maxBytes=LONGEST, backupCount=1, encoding="utf-8")
    except OSError as error:
        log.warning("no log for the ground: %s", error)
        yield
        return
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        handler.close()
