"""Starts a process, kills one that died or hangs, and delays the restarts of one that dies often."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, NamedTuple, Protocol, TypeVar

log = logging.getLogger(__name__)

SILENT_AFTER = 2.0
"""Seconds without a sign of life, plus those of one step, after which requests are refused: their sender
would wait in vain."""
_STALLED = 1.0
"""Seconds between two polls after which the supervisor itself was stalled: the silence so far is its own."""
_MOST_DOUBLED = 32
"""How often a wait is doubled at most: it has been the longest one for long, and a float overflows."""
_DEATHS = 3
_OFTEN = 600.0
"""Seconds. After `_DEATHS` deaths within this time the process counts as unreliable."""


class Restarts(NamedTuple):
    """When a process is killed, and when it is started again. All in seconds.

    silent_for: it is killed after so long without a sign of life, plus the time of four steps of its own.
    loading: the limit that counts instead while it loads.
    first, longest: the wait before it is started again. The first restart does not wait; the second waits
    `first`, and the wait doubles with each further death up to `longest`. A process that ran for `longest`
    starts from the beginning of that series.
    """

    silent_for: float
    loading: float
    first: float
    longest: float


def back_off(failures: int, first: float, longest: float) -> float:
    """Return the s to wait after so many failures in a row: none, `first`, twice that ... `longest`."""
    return min(first * 2.0 ** min(failures - 1, _MOST_DOUBLED), longest) if failures > 0 else 0.0


class Failure(NamedTuple):
    """Why the process is killed. cause: for the log. trouble: for the operator, what it does or did.

    E.g. "ended: SIGSEGV" and "died (SIGSEGV)".
    """

    cause: str
    trouble: str


class Killable(Protocol):
    """A started process."""

    def close(self) -> None:
        """Kill the process."""


_Child = TypeVar("_Child", bound=Killable)


class Watchdog(Generic[_Child]):
    """Owns a process. It runs once it has reported that it is ready; until then it loads.

    child: the process, None while there is none. restarted: how often it was killed or had died.
    """

    def __init__(self, launch: Callable[[], _Child], limits: Restarts, name: str) -> None:
        """launch: starts a process or raises OSError. name: for the log."""
        self._launch = launch
        self._name = name
        self._limits = limits
        self._step: float | None = None
        """Seconds of a step; None while no process runs."""
        self._restart_at = float("-inf")
        self._started_at = self._reported_at = self._polled_at = time.monotonic()
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._failures = 0
        self.child: _Child | None = None
        self.restarted = 0

    @property
    def running(self) -> bool:
        """Whether the process has reported that it is ready."""
        return self._step is not None

    @property
    def responsive(self) -> bool:
        """Whether the process runs, and gave a sign of life lately: else no request should wait for it."""
        return self._step is not None and self._polled_at - self._reported_at <= SILENT_AFTER + self._step

    @property
    def alive_at(self) -> float:
        """Return the monotonic seconds of the last sign of life; -inf while no process runs."""
        return self._reported_at if self.running else float("-inf")

    @property
    def unreliable(self) -> bool:
        """Whether the process died three times within ten minutes."""
        return len(self._deaths) == _DEATHS and self._polled_at - self._deaths[0] <= _OFTEN

    @property
    def silence_limit(self) -> float:
        """Return the seconds of silence after which the process counts as hung."""
        if self._step is None:
            return self._limits.loading
        return self._limits.silent_for + 4.0 * self._step

    def polled(self, now: float) -> None:
        """Note that the main loop is alive. Called before all else in a poll."""
        if now - self._polled_at > _STALLED:
            self._reported_at = self._started_at = now
        self._polled_at = now

    def may_start(self, now: float) -> bool:
        """Whether the wait before the next start is over."""
        return now >= self._restart_at

    def start(self, now: float) -> None:
        """Start a process. Raises OSError."""
        self.child = self._launch()
        self._started_at = self._reported_at = now

    def reported(self, now: float) -> None:
        """Note a sign of life."""
        self._reported_at = now

    def ready(self, step: float, now: float) -> None:
        """Note that the process runs from now on. step: seconds of a whole step."""
        self._step, self._started_at = step, now

    def failure(self, ended: str, now: float) -> Failure | None:
        """Return why the process must be killed, None while all is well.

        ended: what `Child.ended` said before the last reports were read.
        """
        if ended:
            return Failure(f"ended: {ended}", f"died ({ended})")
        silent = now - max(self._reported_at, self._started_at)
        if silent > self.silence_limit:
            return Failure(f"gave no sign of life for {silent:.1f} s", "hangs")
        return None

    def restart_later(self, cause: str, now: float, level: int = logging.ERROR) -> None:
        """Kill the process and plan its restart. cause, level: for the log."""
        if self.running and now - self._started_at >= self._limits.longest:
            self._failures = 0
        wait = back_off(self._failures, self._limits.first, self._limits.longest)
        log.log(level, "the %s %s; it is started again in %.0f s", self._name, cause, wait)
        self.kill()
        self._failures += 1
        self._deaths.append(now)
        self._restart_at = now + wait
        self.restarted += 1

    def kill(self) -> None:
        """Kill the process. The camera is free when this returns, unless its driver hangs."""
        if self.child is not None:
            self.child.close()
            self.child = None
        self._step = None
