"""Sends what is recorded to a process that takes it: the supervisor's end. Nothing here waits."""

from __future__ import annotations

import logging
from abc import abstractmethod
from collections import deque
from collections.abc import Iterable
from typing import TypeVar

from companion.observers.recording.messages import LARGEST_PART, RecordedMessage, datagrams, ends_message
from companion.observers.recording.topics import TOPICS
from companion.system.side_process import SideChild, SideService
from companion.system.watchdog import Restarts

log = logging.getLogger(__name__)

BUFFER = 6 * LARGEST_PART
"""Bytes that may wait in the channel of such a process."""
_MOST_WAITING = 8 << 20
"""Bytes that wait for a process that is behind. Beyond that messages are lost, and counted."""

_Child = TypeVar("_Child", bound=SideChild)


class FedService(SideService[_Child]):
    """A process that is sent messages, and what waits for it.

    lost: messages that it was not sent, since the start.
    """

    def __init__(self, name: str, restarts: Restarts, off: str = "") -> None:
        super().__init__(name, restarts, off)
        self.lost = 0
        self._starts = 0
        self._waiting: deque[bytes] = deque()
        self._bytes = 0

    @property
    def listener(self) -> int:
        """The number of the process, which no other one of this service has had; 0: there is none.

        It may be sent messages: they wait while it starts.
        """
        return self._starts if self.child is not None else 0

    def poll(self, now: float) -> None:
        """Keep the process running, hear it, and send it what waits. now: monotonic seconds."""
        super().poll(now)
        with self._guard.survived(f"the {self._name}", now):
            self.flush()

    def feed(self, messages: Iterable[RecordedMessage], now: float) -> None:
        """Send the process messages."""
        if self._off:
            return
        with self._guard.survived(f"the {self._name}", now):
            for message in messages:
                self._queue(message)
            self.flush()

    def flush(self) -> None:
        """Send what waits, as far as the process takes it."""
        while self._waiting and self.send(self._waiting[0]):
            self._bytes -= len(self._waiting.popleft())

    def _queue(self, message: RecordedMessage) -> None:
        try:
            parts = datagrams(message)
        except ValueError as error:
            log.warning(
                "the %s is not sent a message of %s: %s", self._name, TOPICS[message.topic].name, error
            )
            parts = []
        size = sum(map(len, parts))
        if not parts or self.child is None or self._bytes + size > _MOST_WAITING:
            self.lost += 1
            return
        self._bytes += size
        self._waiting += parts

    def _start(self) -> _Child:
        """Start the process: what waited for the one before is lost. Raises OSError."""
        self.lost += sum(map(ends_message, self._waiting))
        self._waiting.clear()
        self._bytes = 0
        self._starts += 1
        return self._start_fed()

    @abstractmethod
    def _start_fed(self) -> _Child:
        """Have the process started. Raises OSError."""
