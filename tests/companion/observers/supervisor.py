"""The supervisor of a side process, as the tests of page, recorder, live view and video run it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from companion.observers.recording.messages import RecordedMessage
from tests.waiting import wait_for

PATIENCE = 20.0
Own = TypeVar("Own", bound="Supervisor")


class Supervisor:
    """Runs `service`, which has a process. slowest: the seconds that it took of a turn at most."""

    service: Any
    slowest = 0.0

    def work(self, now: float, messages: Sequence[RecordedMessage]) -> None:
        """What the main loop does with it in a turn."""
        self.service.poll(now)
        self.service.feed(messages, now)

    def turn(self, messages: Sequence[RecordedMessage] = ()) -> float:
        """One turn of the main loop; returns the seconds that the service took of it."""
        began = time.monotonic()
        self.work(began, messages)
        took = time.monotonic() - began
        self.slowest = max(self.slowest, took)
        time.sleep(0.01)
        return took

    def until(self, fits: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Turn until it is so."""
        wait_for(fits, seconds, self.service.figures, self.turn)

    def ready(self: Own) -> Own:
        """Turn until the process was heard."""
        self.until(lambda: self.service.running and self.pid())
        return self

    def pid(self) -> int:
        """The process id, 0 without a process."""
        child = self.service.child
        return (child.pid or 0) if child is not None else 0

    def close(self) -> None:
        self.service.close()
