"""Exchanges bytes with the vision process, which it starts and kills."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from typing import Protocol

from companion.system.child_process import ChildProcess
from companion.vision.codec import Splitter

COMMAND = (sys.executable, "-m", "companion.vision")
MOST_WAITING = 80 << 20
"""Bytes of requests that may wait for a process that does not read. Beyond that it counts as lost."""
_CHUNK = 1 << 20
_CHUNKS_PER_POLL = 8
_BUFFER = 1 << 20
_REAP_TIMEOUT = 0.2


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
        """Say how the process ended, in two or three words; "" while it runs or is being started.

        Raises OSError where it could not be started.
        """

    def close(self) -> None:
        """Kill the process in whatever state it is, and close the descriptors. May be called repeatedly."""


class VisionChild(ChildProcess):
    """Runs `python -m companion.vision`."""

    def __init__(self, command: Sequence[str] = COMMAND, *, network: bool = True) -> None:
        """Start the process. command: of `ChildProcess`. network: whether its camera needs any.

        Raises OSError.
        """
        unit = "network-vision" if network else "vision"
        super().__init__(command, unit=unit, buffer=_BUFFER, reaped_within=_REAP_TIMEOUT)
        self._splitter = Splitter()
        self._waiting = bytearray()

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
                data = self.channel.recv(_CHUNK)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # a reset: the process died, and `ended` says how
                break
            if not data:
                break
            found += self._splitter.feed(data)
        return found

    def _flush(self) -> None:
        with contextlib.suppress(BlockingIOError, InterruptedError, OSError):
            while self._waiting:
                del self._waiting[: self.channel.send(self._waiting)]
