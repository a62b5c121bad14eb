"""The companion's own log as a file, bounded: the ground may read it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from logging.handlers import QueueHandler, RotatingFileHandler
from pathlib import Path

from companion.storage.writer import Writer

log = logging.getLogger(__name__)

FOLDER = "logs"
NAME = "companion.log"
"""And the one before it, companion.log.1."""
LONGEST = 256 * 1024
"""Bytes of each of the two."""


class _Quiet(RotatingFileHandler):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """A full disk costs lines of this file; they are on stderr."""


class _HandedOver(QueueHandler):
    """Lines for the writer, which puts them into `file` when it comes to that."""

    def __init__(self, writer: Writer, file: RotatingFileHandler) -> None:
        super().__init__(None)  # type: ignore[arg-type]  # `enqueue` knows where to
        self._writer = writer
        self._file = file
        self._lost = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        self._writer.write("log", partial(self._write, record))

    def _write(self, record: logging.LogRecord) -> None:
        lost, self._lost = self._writer.dropped["log"] - self._lost, self._writer.dropped["log"]
        if lost:
            line = logging.LogRecord(
                log.name, logging.WARNING, "", 0, "%d lines lost: slow disk", (lost,), None
            )
            self._file.handle(line)
        self._file.handle(record)


@contextmanager
def logbook(folder: Path, writer: Writer) -> Iterator[None]:
    """Whatever is logged meanwhile is in `folder`/logs too, as far as that can be written."""
    root = logging.getLogger()
    try:
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
        file = _Quiet(folder / FOLDER / NAME, maxBytes=LONGEST, backupCount=1, encoding="utf-8")
    except OSError as error:
        log.warning("no log for the ground: %s", error)
        yield
        return
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    handler = _HandedOver(writer, file)
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        writer.write("log", file.close)
