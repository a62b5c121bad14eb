"""Logs without waiting for whoever takes the lines: a thread writes them to stderr."""

from __future__ import annotations

import contextlib
import copy
import faulthandler
import logging
import os
import queue
import stat
import sys
import threading
import traceback
from logging.handlers import QueueHandler
from typing import NoReturn

MOST_WAITING = 1000
"""Lines that may wait for stderr. Beyond that, new ones are dropped and counted."""
LAST_LINES = 1.0
"""Seconds that the end of a process waits for its last lines."""
_STDERR = 2


class HandOver(QueueHandler):
    """Hands records over to another thread. Only there a traceback becomes text: that reads source files."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        """Return a copy whose text does not change any more."""
        made = copy.copy(record)
        try:
            made.msg = record.getMessage()
        except Exception as error:  # a wrong format in a log call
            made.msg = f"{record.msg!r} cannot be logged: {error!r}"
        made.args = None
        return made


class StderrHandler(HandOver):
    """Writes log lines to stderr in a thread. Only `flush` waits."""

    def __init__(self, descriptor: int = _STDERR) -> None:
        """descriptor: where to write."""
        self._lines: queue.Queue[logging.LogRecord] = queue.Queue(MOST_WAITING)
        super().__init__(self._lines)
        self._descriptor = descriptor
        self._dropped = 0
        threading.Thread(target=self._run, name="stderr", daemon=True).start()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queue a record, or drop it where too many wait."""
        try:
            self._lines.put_nowait(record)
        except queue.Full:
            self._dropped += 1

    def flush(self) -> None:
        """Wait until all lines are written, for `LAST_LINES` s at most."""
        with self._lines.all_tasks_done:
            self._lines.all_tasks_done.wait_for(lambda: not self._lines.unfinished_tasks, LAST_LINES)

    def _run(self) -> None:
        told = 0
        while True:
            self._write(self._lines.get())
            if (dropped := self._dropped) > told:
                text = f"{dropped - told} log lines were dropped: nobody reads stderr"
                self._write(logging.LogRecord(__name__, logging.WARNING, "", 0, text, None, None))
                told = dropped
            self._lines.task_done()

    def _write(self, record: logging.LogRecord) -> None:
        left = f"{self.format(record)}\n".encode(errors="backslashreplace")
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
        except OSError:  # it is closed: there is nobody to tell
            pass


def log_to_stderr(level: int) -> None:
    """Log to stderr from now on, unless something is set up to log already. level: the least that is."""
    if logging.getLogger().handlers:
        return
    # systemd's journal adds the time itself, and sets JOURNAL_STREAM for what it starts.
    time = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "
    logging.basicConfig(
        level=level, format=f"{time}%(levelname)s %(name)s: %(message)s", handlers=[StderrHandler()]
    )


def flush_stderr() -> None:
    """Wait until what was logged is on stderr, for `LAST_LINES` s at most."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, StderrHandler):
            handler.flush()


def say_last(line: str, code: int) -> None:
    """Print a line to stderr after all that was logged. Ends the process with `code` if nobody reads it."""
    flush_stderr()

    def say() -> None:
        sys.stdout.flush()  # what ends the process below would lose it
        print(line, file=sys.stderr)

    printing = threading.Thread(target=say, daemon=True)
    printing.start()
    printing.join(LAST_LINES)
    if printing.is_alive():
        os._exit(code)


def dump_when_aborted() -> None:
    """Have a crash or SIGABRT say on stderr where each thread was. It waits for no reader of a pipe.

    Where stderr is a socket, as that of systemd's journal, systemd kills the process that waits.
    """
    if sys.__stderr__ is not None:
        faulthandler.enable(unread_stderr())


def unread_stderr() -> int:
    """Return a descriptor of stderr; where that is a pipe, writing to it waits for no reader."""
    if stat.S_ISFIFO(os.fstat(_STDERR).st_mode):
        with contextlib.suppress(OSError):  # opened anew, since others that share it may wait for its reader
            return os.open(f"/proc/self/fd/{_STDERR}", os.O_WRONLY | os.O_NONBLOCK)
    return _STDERR


def end_process(code: int) -> NoReturn:
    """End this process once its log lines are on stderr, after `LAST_LINES` s at the latest.

    It waits for no thread: one may run native code, or hang in a call of the disk or of a driver.
    """
    flush_stderr()
    os._exit(code)


def brief(record: logging.LogRecord) -> str:
    """Return a record's text, and where its exception was raised, without the source: that would be read."""
    text = record.getMessage()
    if record.exc_info and record.exc_info[1] is not None:
        _, error, at = record.exc_info
        for frame, line in traceback.walk_tb(at):
            text += f'\n  File "{frame.f_code.co_filename}", line {line}, in {frame.f_code.co_name}'
        text += f"\n{type(error).__name__}: {error}"
    return text
