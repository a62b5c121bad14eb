"""Starts the vision process with a fresh interpreter, exchanges bytes with it, and kills it."""

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
"""Bytes of requests that may wait for a process that does not read. Beyond that it counts as lost."""
_CHUNK = 1 << 20
_CHUNKS_PER_POLL = 8
_BUFFER = 1 << 20
_REAP_TIMEOUT = 0.2
"""Seconds to wait for a killed process. One in an uninterruptible system call is left to the kernel."""


class Child(Protocol):
    """Talks to one started vision process. No method blocks except `close`."""

    def fileno(self) -> int | None:
        """Return the descriptor that is readable when reports wait; None after `close`."""

    def send(self, message: bytes) -> bool:
        """Queue a request. False when too many bytes wait already."""

    def receive(self) -> list[bytes]:
        """Return the complete reports, without their length prefixes. Raises CodecError."""

    @property
    def idle(self) -> bool:
        """Whether no request waits to be sent."""

    def ended(self) -> str:
        """Say how the process ended, in two or three words; "" while it runs."""

    def close(self) -> None:
        """Kill the process in whatever state it is, and close the descriptors. May be called repeatedly."""


class VisionChild:
    """Runs `python -m companion.vision`, which inherits one descriptor: its end of a socket pair."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        """Start the process. command: gets a descriptor and our process id appended. Raises OSError."""
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
                stdout=subprocess.DEVNULL,  # stderr is inherited, for faulthandler
            )
        except OSError:
            self._channel.close()
            raise
        finally:
            far.close()

    @property
    def pid(self) -> int:
        """Return the process id."""
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
            except OSError:  # a reset: the process died, and `ended` says how
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
            with contextlib.suppress(subprocess.TimeoutExpired):  # a camera driver may delay its end
                self._process.wait(_REAP_TIMEOUT)
        self._channel.close()

    def _flush(self) -> None:
        with contextlib.suppress(BlockingIOError, InterruptedError, OSError):
            while self._waiting:
                del self._waiting[: self._channel.send(self._waiting)]
