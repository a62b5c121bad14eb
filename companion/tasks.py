"""Every moving part of the daemon on one screen. Liveness limits come from this table."""

from __future__ import annotations

from typing import NamedTuple

from companion.calls.numbers import Numbers


class Task(NamedTuple):
    """One row. silent_for: seconds without a sign of life until it counts as dead; None: not watched."""

    name: str
    does: str
    runs: str
    silent_for: float | None
    when_silent: str


def tasks(numbers: Numbers) -> tuple[Task, ...]:
    """The table, with the limits that follow from the freshness limit T."""
    fresh = numbers.freshness
    # fmt: off
    return (
        Task("camera",  "keeps the newest frame",         "thread, its own rate",       fresh, "fault: hold"),
        Task("eyes",    "judges frames, applies answers", "thread, at the judged rate", fresh, "fault: hold"),
        Task("link",    "hears and sends MAVLink",        "main loop, 50 times a s",   None,  "no heartbeat"),
        Task("calls",   "decides: call, hold, resume",    "main loop, on every input", None,  "no heartbeat"),
        Task("writer",  "journal, pictures, status, log", "thread, when there is news", None,  "said"),
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
