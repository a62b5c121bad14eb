"""Shows the live picture of one camera, in a process of its own, while the page asks for it."""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection, Pipe
from typing import Any

from anytraverse.regions import Box
from companion.cameras import CameraOptions
from companion.desk.check.watching import CameraDelivery
from companion.desk.setup.preview_process import LARGEST
from companion.system.isolated import isolated

COMMAND = isolated("companion.desk.setup.preview_process")
FORGOTTEN = 8.0
"""Seconds without a question after which the camera is closed."""
SILENT = 12.0
"""Seconds without a message after which its process is killed."""
AGAIN = 3.0
"""Seconds until a camera that failed is opened again."""
_TICK = 0.25
_CLOSED_WITHIN = 1.5
"""Seconds in which its process closes the camera, before it is killed."""
_STARTS = CameraDelivery("it is being opened")
_FIELDS = {one.name: one for one in fields(CameraDelivery)}


@dataclass(frozen=True)
class PreviewPicture:
    """The newest picture. number: rises with each one, 0 before the first. jpeg: may be empty. at: when."""

    number: int = 0
    seen: CameraDelivery = _STARTS
    jpeg: bytes = b""
    at: float = 0.0


@dataclass(frozen=True)
class _Wanted:
    source: str
    options: CameraOptions
    roi: Box


class Preview:
    """Holds at most one camera open. Any thread may ask."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._changed = threading.Condition()
        self._wanted: _Wanted | None = None
        self._shown: tuple[str, CameraOptions] | None = None
        """The camera that `_newest` is of."""
        self._asked_at = 0.0
        self._newest = PreviewPicture()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="preview", daemon=True)
        self._thread.start()

    def ask(self, source: str, options: CameraOptions, roi: Box) -> PreviewPicture:
        """Return the newest picture of this camera, which is opened, and the one before closed."""
        with self._changed:
            self._asked_at = self._clock()
            if (source, options) != self._shown:
                self._shown = source, options
                self._newest = PreviewPicture(self._newest.number)
                self._wanted = None
            if self._wanted is None:
                self._wanted = _Wanted(source, options, roi)
                self._changed.notify()
            return self._newest

    @property
    def newest(self) -> PreviewPicture:
        """The newest picture, of whichever camera was asked for last."""
        return self._newest

    def release(self) -> None:
        """Close the camera, so that somebody else can open it; the newest picture stays."""
        with self._changed:
            self._wanted = None
            self._changed.notify()

    def close(self) -> None:
        """Close the camera, and end."""
        with self._changed:
            self._ended, self._wanted = True, None
            self._changed.notify()
        self._thread.join(3.0)

    def _run(self) -> None:
        while not self._ended:
            with self._changed:
                while self._wanted is None and not self._ended:
                    self._changed.wait(_TICK)
                wanted = self._wanted
            if wanted is not None:
                self._watch(wanted)
                self._rest(wanted)

    def _rest(self, wanted: _Wanted) -> None:
        """Wait before a camera that failed is opened again, unless another one is wanted."""
        until = self._clock() + AGAIN
        with self._changed:
            while self._wanted is wanted and self._clock() < until:
                self._changed.wait(_TICK)

    def _watch(self, wanted: _Wanted) -> None:
        """Run the process, and take what it sends, while this camera is wanted."""
        ours, theirs = Pipe()
        with ours:
            try:
                with theirs:
                    process = _started(theirs.fileno())
            except OSError as error:
                self._failed(
                    wanted, f"its process cannot be started: {(error.strerror or str(error)).lower()}"
                )
                return
            try:
                with suppress(OSError):  # it has died at once: that is said below
                    ours.send((wanted.source, wanted.options, wanted.roi))
                self._take(wanted, ours, process)
            finally:
                ours.close()
                _end(process)

    def _take(self, wanted: _Wanted, ours: Connection, process: subprocess.Popen[bytes]) -> None:
        heard_at = self._clock()
        while True:
            with self._changed:
                if self._clock() - self._asked_at > FORGOTTEN and self._wanted is wanted:
                    self._wanted = None
                if self._wanted is not wanted:
                    return
            if ours.poll(_TICK):
                try:
                    message = ours.recv_bytes(LARGEST)
                except (EOFError, OSError):
                    self._failed(wanted, f"the camera's process ended{_how(process)}")
                    return
                heard_at = self._clock()
                self._tell(wanted, *_read(message))
            elif self._clock() - heard_at > SILENT:
                self._failed(wanted, f"the camera's driver says nothing for {SILENT:.0f} s: it hangs")
                return

    def _failed(self, wanted: _Wanted, why: str) -> None:
        if self._newest.jpeg or not self._newest.seen.trouble or self._newest.seen is _STARTS:
            self._tell(wanted, CameraDelivery(why), b"")

    def _tell(self, wanted: _Wanted, seen: CameraDelivery, jpeg: bytes) -> None:
        with self._changed:
            if self._wanted is wanted:
                self._newest = PreviewPicture(self._newest.number + 1, seen, jpeg, self._clock())


def _started(descriptor: int) -> subprocess.Popen[bytes]:
    """Start the camera's process. descriptor: its end of the connection. Raises OSError."""
    command = [*COMMAND, str(descriptor), str(os.getpid())]
    # Control-C in the terminal is for whoever ends it in turn.
    return subprocess.Popen(command, pass_fds=[descriptor], stdin=subprocess.DEVNULL, start_new_session=True)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process. It closes the camera first: a program of it would stay."""
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_CLOSED_WITHIN)
    process.kill()
    with suppress(subprocess.TimeoutExpired):  # a driver in the kernel may delay its end
        process.wait(1.0)


def _how(process: subprocess.Popen[bytes]) -> str:
    with suppress(subprocess.TimeoutExpired):
        process.wait(0.5)
    return "" if process.returncode in (None, 0) else f" (exit code {process.returncode})"


def _read(message: bytes) -> tuple[CameraDelivery, bytes]:
    """Read what the camera's process sent. It runs drivers: what is no `CameraDelivery` is a failure."""
    line, _, jpeg = message.partition(b"\n")
    try:
        told: Any = json.loads(line)
        return CameraDelivery(**{name: told[name] for name in _FIELDS}), jpeg
    except (ValueError, KeyError, TypeError):
        return CameraDelivery("the camera's process sent what cannot be read"), b""
