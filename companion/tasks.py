"""Every moving part of the daemon on one screen. Liveness limits and restarts come from this table."""

from __future__ import annotations

from typing import NamedTuple

from companion.calls.numbers import Numbers


class Restarts(NamedTuple):
    """When a process is killed, and when it is started again. Seconds.

    silent_for: without a sign of life, to which four of its steps are added. loading: the same while it
    loads. first, longest: the wait before it is started again, which doubles from death to death; the first
    death in a while costs no wait. One that ran for `longest` begins anew.
    """

    silent_for: float
    loading: float
    first: float
    longest: float


VISION = Restarts(silent_for=3.0, loading=180.0, first=2.0, longest=60.0)


class Task(NamedTuple):
    """One row. silent_for: seconds without a sign of life until it counts as dead; None: not watched.

    restarts: None for what ends with the daemon.
    """

    name: str
    does: str
    runs: str
    silent_for: float | None
    when_silent: str
    restarts: Restarts | None = None


def tasks(numbers: Numbers) -> tuple[Task, ...]:
    """The table, with the limits that follow from the freshness limit T."""
    fresh = numbers.freshness
    # fmt: off
    return (
        Task("camera",  "keeps the newest frame",         "vision process, own rate", fresh, "fault: hold"),
        Task("vision",  "judges frames, applies answers", "vision process, as asked", fresh, "fault: hold",
             VISION),
        Task("link",    "hears and sends MAVLink",        "main loop, 50 times a s",  None,  "no heartbeat"),
        Task("calls",   "decides: call, hold, resume",    "main loop, every input",   None,  "no heartbeat"),
        Task("reader",  "files that are asked for",       "thread, when asked",       None,  "refused"),
        Task("writer",  "journal, pictures, status, log", "thread, when there is news", None, "said"),
    )
    # fmt: on


class Liveness:
    """When each watched task last gave a sign of life."""

    def __init__(self, table: tuple[Task, ...], now: float) -> None:
        self._limits = {task.name: task.silent_for for task in table if task.silent_for is not None}
        self._seen = dict.fromkeys(self._limits, now)

    def beat(self, name: str, at: float) -> None:
        """`name` was alive at `at`."""
        self._seen[name] = max(self._seen[name], at)

    def silent(self, now: float) -> list[str]:
        """The tasks that have been silent for too long, the most basic first."""
        return [name for name, limit in self._limits.items() if now - self._seen[name] > limit]
