"""Reads raw pictures from a program's standard output: `pipe:COMMAND`, for CSI cameras and many others."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections import deque
from heapq import nlargest
from itertools import pairwise

import numpy as np

from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, NoFrameYet, SourceError
from companion.cameras.late_frames import CAME_LATE, LateFrames
from companion.cameras.pixel_formats import frame_bytes, to_rgb
from companion.cameras.places import pipe_words
from companion.cameras.shown import plain_words, program

_log = logging.getLogger(__name__)

_PIPE_BYTES = 1 << 18
_LONGEST_LINE = 300
_LINES_LOGGED = 20
"""Lines of the program's standard error that are logged at each start, at most."""
_KNOWN_LINES = deque[str](maxlen=200)
"""Lines that were logged, without their numbers: a program that is started again says them again."""
_TERM_GRACE = 0.5
"""Seconds for the program to end by SIGTERM, so that it can release its camera; then SIGKILL."""
_WRONG_SIZE_AFTER = 10
"""Long waits in a row that are equally many bytes apart, after which the configured size is wrong."""
_WAITS = 1000
"""Waits that are looked at."""

_RUN = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
if os.getppid() == int(sys.argv[1]):
    os.execvp(sys.argv[2], sys.argv[2:])
"""
"""Has the kernel kill the program when the camera's thread ends, then becomes the program."""


class Pipe:
    """Runs a program in a process group of its own, and reads pictures of a fixed size from its output."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        width, height, form = options.width, options.height, options.pixel_format
        try:
            self._size = frame_bytes(form, width, height)
        except ValueError as error:
            raise SourceError(f"{error}: correct [camera]") from error
        self._width, self._height, self._format = width or 0, height or 0, form or ""
        self._source = place
        self._name = program(place) or "the program"
        command = _split(place, self._name)
        self._latency = options.latency
        self._late = LateFrames(options.freshness)
        self._sizes = _WrongSize(self._size)
        self._last_words = ""
        self._lines_left = _LINES_LOGGED
        self._error_text = b""
        self._filled = 0
        self._raw = np.empty(self._size, np.uint8)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _RUN, str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise CameraError(f"{self._name} cannot be started ({error.strerror}): try again") from error
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        self._out, self._err = self._process.stdout.fileno(), self._process.stderr.fileno()
        os.set_blocking(self._err, False)
        with contextlib.suppress(OSError):  # more than the user's share of pipe memory: slower, but it works
            fcntl.fcntl(self._out, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)

    def read(self, timeout: float) -> Capture:
        deadline = time.monotonic() + timeout
        while self._filled < self._size:
            began = time.monotonic()
            if began >= deadline:
                raise NoFrameYet(f"{self._name} has sent no whole picture in {timeout:g} s: read again")
            streams = [self._out] if self._err < 0 else [self._out, self._err]
            readable = select.select(streams, [], [], deadline - began)[0]
            if self._err in readable:
                self._read_errors()
            if self._out in readable:
                self._sizes.waited(self._filled, time.monotonic() - began)
                count = os.readv(self._out, [self._raw.data[self._filled :]])
                if count == 0:
                    raise CameraError(self._why_ended())
                self._filled += count
        now = time.monotonic()
        self._filled = 0
        if self._sizes.is_wrong():
            raise CameraError(
                f"{self._name} does not send pictures of {self._width} x {self._height} {self._format}: "
                "make [camera] width, height and pixel_format those of the command"
            )
        if self._late.is_late(now):
            raise BadFrame(CAME_LATE)
        image = to_rgb(self._raw, self._format, self._width, self._height)
        if np.shares_memory(image, self._raw):
            self._raw = np.empty(self._size, np.uint8)
        return Capture(now - self._latency, image, "arrival")

    def close(self) -> None:
        for number, grace in ((signal.SIGTERM, _TERM_GRACE), (signal.SIGKILL, _TERM_GRACE)):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):  # a driver may delay its end
                self._process.wait(grace)
        for stream in (self._process.stdout, self._process.stderr):
            assert stream is not None
            stream.close()

    @property
    def pid(self) -> int:
        """The program's process id, which is its group's, too."""
        return self._process.pid

    def _why_ended(self) -> str:
        """Say how the program ended, and its last line."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_TERM_GRACE)
        self._read_errors()
        code = self._process.returncode
        how = "closed its output" if code is None else f"ended with exit code {code}"
        if code is not None and code < 0:
            how = f"was killed by signal {-code}"
        said = f": {self._last_words}" if self._last_words else ""
        return f"{self._name} {how}{said}; try the command of [camera] source in a shell"

    def _read_errors(self) -> None:
        if self._err < 0:
            return
        try:
            data = os.read(self._err, 1 << 16)
        except BlockingIOError:
            return
        if not data:
            self._err = -1  # closed, and would be readable for ever
        *lines, rest = (self._error_text + data).replace(b"\r", b"\n").split(b"\n")
        self._error_text = rest[-_LONGEST_LINE:]
        for line in lines if data else [*lines, rest]:
            self._log_line(plain_words(line.decode(errors="replace"), self._source)[:_LONGEST_LINE])

    def _log_line(self, line: str) -> None:
        if not line:
            return
        self._last_words = line
        shape = re.sub(r"[0-9]+", "0", line)
        if shape in _KNOWN_LINES or self._lines_left <= 0:
            return
        _KNOWN_LINES.append(shape)
        self._lines_left -= 1
        _log.info("%s: %s", self._name, line)


class _WrongSize:
    """Notices pictures of another size than configured.

    A program writes a picture at once and then waits for the next one. So its long waits are all equally many
    bytes apart, and that is the size. A whole multiple of the size is not noticed. Waits that are not equally
    far apart, or by a power of two, are of what carries the pictures, such as a slow network.
    """

    def __init__(self, size: int) -> None:
        """size: bytes of a picture, as configured."""
        self._size = size
        self._pictures = 0
        self._waits: deque[tuple[float, int]] = deque(maxlen=_WAITS)

    def waited(self, filled: int, seconds: float) -> None:
        """Take note of a wait for data, in s, after `filled` bytes of a picture."""
        place = self._pictures * self._size + filled
        if place:  # else it is the program's start
            self._waits.append((seconds, place))

    def is_wrong(self) -> bool:
        """Whether the size is wrong, as far as the pictures up to the one that is complete now show."""
        self._pictures += 1
        # The very longest may be stalls of a busy computer, which come anywhere.
        usual = nlargest(_WRONG_SIZE_AFTER + 1, (seconds for seconds, _ in self._waits))[-1:] or [0.0]
        long = [(seconds, place) for seconds, place in self._waits if 2.0 * seconds >= usual[0]]
        apart = {after - before for (_, before), (_, after) in pairwise(long[-_WRONG_SIZE_AFTER - 1 :])}
        if len(long) <= _WRONG_SIZE_AFTER or len(apart) != 1:
            return False
        (size,) = apart
        return size % self._size != 0 and size & (size - 1) != 0


def _split(place: str, name: str) -> list[str]:
    """Split a command like a shell does. Raises SourceError when there is no such program. name: its own."""
    command = pipe_words(place)
    if shutil.which(command[0]) is None:
        raise CameraError(f"{name} is not installed, or not executable: install it, or write its full path")
    return command
