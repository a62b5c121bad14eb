"""Runs a process of the demo and reads its output line by line without blocking."""

from __future__ import annotations

import contextlib
import ctypes
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import IO

MAX_LINES = 10_000
_SET_DEATH_SIGNAL = 1
_LIBC = ctypes.CDLL(None)


class ChildError(RuntimeError):
    """Raised for a process of the demo that did not start or ended too early; its log says why."""


class LoggedProcess:
    """Runs `python -m ...`, gives its stdout as lines and writes its stderr to a log file.

    interactive: the process uses the terminal itself; its lines are then those of the file `events` that it
    writes. When the thread that started it ends, the kernel sends it the signal `orphaned`: choose SIGKILL
    for a process that may be stopped (SIGSTOP), since no other signal ends that.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        log: Path,
        *,
        interactive: bool = False,
        events: Path | None = None,
        orphaned: signal.Signals = signal.SIGTERM,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """environment: variables to set besides those that it inherits."""
        self.name = name
        self.log = log
        self._lines: queue.Queue[tuple[float, str]] = queue.Queue(MAX_LINES)
        self._file: IO[str] | None = None
        self._unfinished = ""
        if events is not None:
            events.touch()
            self._file = events.open(encoding="utf-8")
        pipe = None if interactive else subprocess.PIPE
        with log.open("ab") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=pipe,
                stdout=pipe,
                stderr=errors,
                env={**os.environ, **(environment or {})},
                text=True,
                bufsize=1,
                preexec_fn=partial(_end_with_parent, orphaned),  # noqa: PLW1509 - it takes no lock
            )
        if self.process.stdout is not None:
            threading.Thread(target=self._read, args=(self.process.stdout,), daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.process.poll() is None

    def lines(self) -> list[tuple[float, str]]:
        """Returns the lines printed since the last call, each with the monotonic seconds when it was read."""
        taken = self._read_file()
        with contextlib.suppress(queue.Empty):
            while True:
                taken.append(self._lines.get_nowait())
        return taken

    def first_line(self, timeout: float) -> str:
        """Waits for the first line. Raises ChildError when none comes within `timeout` s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            with contextlib.suppress(queue.Empty):
                return self._lines.get(timeout=0.1)[1]
            if not self.running:
                break
        raise self.error("did not start")

    def error(self, what: str) -> ChildError:
        """Makes an error that says what went wrong, where the log is and what its last line says."""
        log = self.log.read_text(encoding="utf-8", errors="replace").split("\n") if self.log.exists() else []
        last = next((line.strip() for line in reversed(log) if line.strip()), "")
        return ChildError(f"{self.name} {what}: see {self.log}" + (f", which ends: {last}" if last else ""))

    def type(self, line: str) -> None:
        """Writes a line to its standard input; does nothing once it has ended."""
        if self.process.stdin is not None and self.running:
            with contextlib.suppress(OSError):
                self.process.stdin.write(line + "\n")
                self.process.stdin.flush()

    def stop(self, timeout: float = 5.0) -> None:
        """Sends SIGTERM, and SIGKILL when the process has not ended after `timeout` s."""
        if self.running:
            self.process.terminate()
        try:
            self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(timeout)

    def _read_file(self) -> list[tuple[float, str]]:
        if self._file is None:
            return []
        *complete, self._unfinished = (self._unfinished + self._file.read()).split("\n")
        return [(time.monotonic(), line) for line in complete]

    def _read(self, stream: IO[str]) -> None:
        with contextlib.suppress(ValueError, OSError):
            for line in stream:
                with contextlib.suppress(queue.Full):
                    self._lines.put_nowait((time.monotonic(), line.rstrip("\n")))


def _end_with_parent(number: signal.Signals) -> None:
    _LIBC.prctl(_SET_DEATH_SIGNAL, number)
