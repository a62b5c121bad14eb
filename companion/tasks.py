"""Lists every moving part of the daemon. Liveness limits and restart times come from this table."""

from __future__ import annotations

from typing import NamedTuple

from companion.calls.numbers import Numbers
from companion.system.watchdog import Restarts

VISION = Restarts(silent_for=3.0, loading=180.0, first=2.0, longest=60.0)
PAGE = Restarts(silent_for=10.0, loading=60.0, first=2.0, longest=60.0)
VIDEO = Restarts(silent_for=5.0, loading=60.0, first=2.0, longest=60.0)
RECORDER = Restarts(silent_for=10.0, loading=60.0, first=2.0, longest=60.0)
LIVE = Restarts(silent_for=10.0, loading=60.0, first=2.0, longest=60.0)


class Task(NamedTuple):
    """One row of the table.

    name, does, runs: what it is called, what it does, and where and when it runs.
    silent_for: seconds without a sign of life until it counts as dead; None: it is not watched.
    when_silent: what follows then. restarts: None for a part that ends only with the daemon.
    """

    name: str
    does: str
    runs: str
    silent_for: float | None
    when_silent: str
    restarts: Restarts | None = None


def tasks(numbers: Numbers) -> tuple[Task, ...]:
    """Return the table. Its limits follow from the freshness limit T, `Numbers.freshness`."""
    fresh = numbers.freshness
    # fmt: off
    return (
        Task("camera",  "keeps the newest frame",         "vision process, own rate", fresh, "fault: hold"),
        Task("vision",  "judges frames, applies answers", "vision process, as asked", fresh, "fault: hold",
             VISION),
        Task("link",    "receives and sends MAVLink",     "main loop, 50 times a s",  None,  "no heartbeat"),
        Task("calls",   "decides: call, hold, resume",    "main loop, every input",   None,  "no heartbeat"),
        Task("reader",  "reads files for the ground",     "thread, on request",       None,  "refused"),
        Task("writer",  "writes journal, pictures, log",  "thread, on every change",  None,  "reported"),
        Task("checks",  "measures and checks the computer", "thread, once a second",  None, "figures age"),
        Task("page",    "shows all of it to a browser", "web process, once a s",    None,  "no page", PAGE),
        Task("video",   "serves the camera's video",   "video process, own rate",   None,  "no video", VIDEO),
        Task("recorder", "writes recordings into a ring", "process, as told",       None,  "no recording",
             RECORDER),
        Task("live view", "shows what is recorded to viewers", "process, as told",  None,  "no live view",
             LIVE),
        Task("packer",  "packs an incident file",      "process, on request",     None,  "killed"),
        Task("deleter", "deletes a recording",         "thread, on request",      None,  "no reply"),
        Task("alert",   "posts to the owner's URL",       "thread, on a call",        None,  "counted"),
        Task("signing", "syncs signing's clock",          "thread, while signing",    None,  "reported"),
    )
    # fmt: on


class Liveness:
    """Records when each watched task last gave a sign of life."""

    def __init__(self, table: tuple[Task, ...], now: float) -> None:
        self._limits = {task.name: task.silent_for for task in table if task.silent_for is not None}
        self._alive_at = dict.fromkeys(self._limits, now)

    def beat(self, name: str, at: float) -> None:
        """Record that `name` was alive at `at`, monotonic seconds."""
        self._alive_at[name] = max(self._alive_at[name], at)

    def silent(self, now: float) -> list[str]:
        """Return the tasks that have been silent for too long, in the order of the table."""
        return [name for name, limit in self._limits.items() if now - self._alive_at[name] > limit]
