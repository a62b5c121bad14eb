"""Virtual time, in which a whole daemon runs as fast as it can."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        """As `time.sleep`."""
        self.now += seconds


@contextmanager
def virtual_time() -> Iterator[Clock]:
    """Replaces `time.monotonic` by the clock, and makes the daemon wait for nothing."""
    clock = Clock()
    with mock.patch("time.monotonic", clock), mock.patch("companion.daemon.daemon.TICK", 0.0):
        yield clock
