"""Takes what the supervisor sends to a process, and reports how it goes: the end of that process."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable

from companion.observers.recording.messages import LARGEST_PART, Joiner, RecordedMessage

BEAT = 0.5
"""Seconds between two reports."""


def take_messages(
    descriptor: int, take: Callable[[RecordedMessage], None], report: Callable[[], bytes]
) -> None:
    """Take messages until the supervisor has closed the channel, or is gone.

    descriptor: of the channel. report: what is told twice a second. Neither may wait. Raises ValueError for
    what is no message.
    """
    joiner, reported_at = Joiner(), float("-inf")
    with (
        contextlib.suppress(ConnectionResetError, BrokenPipeError),
        socket.socket(fileno=descriptor) as channel,
    ):
        channel.settimeout(0)
        while True:
            now = time.monotonic()
            if now - reported_at >= BEAT:
                reported_at = now
                with contextlib.suppress(BlockingIOError):
                    channel.send(report())
            if not select.select([channel], [], [], BEAT)[0]:
                continue
            part = channel.recv(LARGEST_PART)
            if not part:
                return
            if (message := joiner.feed(part)) is not None:
                take(message)
