"""Writes the companion's log to a file of bounded size, which the ground can download."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from logging.handlers import RotatingFileHandler
from pathlib import Path

from companion.storage.writer import Writer
from companion.system.log_lines import HandOver

log = logging.getLogger(__name__)

FOLDER = "logs"
NAME = "companion.log"
"""The file before it is companion.log.1."""
LONGEST = 256 * 1024
"""Bytes of each of the two files."""


class _LossyFileHandler(RotatingFileHandler):
    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Ignore a failed write, as on a full disk: stderr has the line, too."""


class _WriterHandler(HandOver):
    """Passes log records to the writer thread, which writes them to `file`."""

    def __init__(self, writer: Writer, file: RotatingFileHandler) -> None:
        super().__init__(None)  # type: ignore[arg-type]  # `enqueue` knows where to
        self._writer = writer
        self._file = file
        self._lost = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        self._writer.queue_job("log", partial(self._write, record))

    def _write(self, record: logging.LogRecord) -> None:
        lost, self._lost = self._writer.dropped["log"] - self._lost, self._writer.dropped["log"]
        if lost:
            line = logging.LogRecord(
                log.name, logging.WARNING, "", 0, "%d lines lost: slow disk", (lost,), None
            )
            self._file.handle(line)
        self._file.handle(record)


@contextmanager
def log_to_file(folder: Path, writer: Writer) -> Iterator[None]:
    """Write everything that is logged within the block to `folder`/logs, too, as far as the disk allows."""
    root = logging.getLogger()
    try:
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
        file = _LossyFileHandler(folder / FOLDER / NAME, maxBytes=LONGEST, backupCount=1, encoding="utf-8")
    except OSError as error:
        log.warning("no log file for the ground: %s", error)
        yield
        return
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    handler = _WriterHandler(writer, file)
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        writer.queue_job("log", file.close)
