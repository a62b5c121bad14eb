"""The vision process as the supervisor holds it: started with a fresh interpreter, killed when it must be."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from typing import Protocol

from companion.vision.codec import Splitter

COMMAND = (sys.executable, "-m", "companion.vision")
MOST_WAITING = 80 << 20
"""Bytes of requests that may wait for a process that does not read: a full channel is a lost process."""
_CHUNK = 1 << 20
_CHUNKS_PER_POLL = 8
_BUFFER = 1 << 20
_REAPED_WITHIN = 0.2
"""Seconds that a killed process is waited for: one in an uninterruptible call is left to the kernel."""


class Child(Protocol):
    """A started vision process and the channel to it. Nothing here waits, but for `close`."""

    def fileno(self) -> int | None:
        """Readable when reports wait; None without a descriptor."""

    def send(self, message: bytes) -> bool:
        """Queue a request. False when too much waits already."""

    def receive(self) -> list[bytes]:
        """The reports that are complete, without their lengths. Raises CodecError."""

    @property
    def idle(self) -> bool:
        """Whether no request waits to be sent."""

    def ended(self) -> str:
        """How the process ended, in two or three words, "" while it runs."""

    def close(self) -> None:
        """Kill it, whatever state it is in, and give its descriptors back; more than once is fine."""


class VisionChild:
    """`python -m companion.vision`. Its end of the channel is the one descriptor that it inherits."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        """command: of a program that takes a descriptor and our process id. Raises OSError."""
        self._splitter = Splitter()
        self._waiting = bytearray()
        self._channel, far = socket.socketpair()
        for end in (self._channel, far):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._channel.settimeout(0)
        try:
            self._process = subprocess.Popen(
                [*command, str(far.fileno()), str(os.getpid())],
                pass_fds=[far.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        except OSError:
            self._channel.close()
            raise
        finally:
            far.close()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def fileno(self) -> int | None:
        return self._channel.fileno() if self._channel.fileno() >= 0 else None

    @property
    def idle(self) -> bool:
        return not self._waiting

    def send(self, message: bytes) -> bool:
        if len(self._waiting) + len(message) > MOST_WAITING:
            return False
        self._waiting += message
        self._flush()
        return True

    def receive(self) -> list[bytes]:
        self._flush()
        found: list[bytes] = []
        for _ in range(_CHUNKS_PER_POLL):
            try:
                data = self._channel.recv(_CHUNK)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # a reset: how it ended is asked for elsewhere
                break
            if not data:
                break
            found += self._splitter.feed(data)
        return found

    def ended(self) -> str:
        code = self._process.poll()
        if code is None:
            return ""
        if code >= 0:
            return f"exit code {code}"
        with contextlib.suppress(ValueError):
            return signal.Signals(-code).name
        return f"signal {-code}"

    def close(self) -> None:
        if self._process.returncode is None:
            self._process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):  # a driver may keep it for a while
                self._process.wait(_REAPED_WITHIN)
        self._channel.close()

    def _flush(self) -> None:
        with contextlib.suppress(BlockingIOError, InterruptedError, OSError):
            while self._waiting:
                del self._waiting[: self._channel.send(self._waiting)]
