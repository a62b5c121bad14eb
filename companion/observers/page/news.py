"""Holds what the supervisor has told last, and judges whether it still counts."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from companion.observers.page.messages import PageMessageKind
from companion.system.datagrams import Datagram

FRESH = 3.0
"""Seconds after which what was told counts as outdated. It comes once a second."""
PICTURE_FRESH = 5.0
"""Seconds after its capture from which a picture is not shown any more."""
POINTS = 120
"""Points that are plotted: two minutes."""
SILENT = "no news from the companion"
WELL = frozenset({"ok", "calling", "holding", "blocked", "off"})
"""States in which the companion does its work. Any other one, or none, is not known to be well."""


class _Picture(NamedTuple):
    """A drawn frame. captured_at: monotonic seconds. jpeg: its bytes."""

    frame: int
    captured_at: float
    jpeg: bytes


class News:
    """Keeps the newest news and picture, and wakes whoever waits for more.

    told: the newest documents, {} before the first. told_at: monotonic seconds when they were so. picture:
    the newest one, None before the first.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._changed = asyncio.Event()
        self._since = clock()
        self._began_here = False
        """Whether the present state began while this process ran, so that its beginning is known."""
        self.told: Mapping[str, Any] = {}
        self.told_at = float("-inf")
        self.picture: _Picture | None = None
        self.from_above = b""
        """The map of the ground that is shown with the picture, PNG; b"" for none."""
        self.points: deque[tuple[float, Any, Any]] = deque(maxlen=POINTS)
        """When the region of interest was how drivable and how uncertain: what is plotted."""

    def take(self, message: Datagram) -> None:
        """Take what the supervisor tells. Raises ValueError for what it never tells."""
        if message.kind not in (PageMessageKind.NEWS, PageMessageKind.PICTURE, PageMessageKind.MAP):
            raise ValueError("a second setup, or an acknowledgement of nothing")
        content = dict(message.content)
        at = content.pop("at", None)
        if not isinstance(at, float | int):
            raise ValueError("news or a picture without time")
        at = min(at, self._clock())
        if message.kind == PageMessageKind.NEWS:
            before = self.state
            self.told, self.told_at = content, at
            ahead = content.get("ahead")
            if isinstance(ahead, dict):
                self.points.append((round(at, 2), ahead.get("traversability"), ahead.get("uncertainty")))
            if self.state != before:
                self._since, self._began_here = at, before != ""
        elif message.kind == PageMessageKind.MAP:
            self.from_above = message.data
        else:
            frame = content.get("frame")
            if not isinstance(frame, int):
                raise ValueError("a picture without frame")
            self.picture = _Picture(frame, at, message.data)
        self.wake()

    def wake(self) -> None:
        """Wake whoever waits for more."""
        self._changed.set()
        self._changed = asyncio.Event()

    @property
    def state(self) -> str:
        """Return the state's name as last told, "" when none was."""
        status = self.told.get("status")
        state = status.get("state") if isinstance(status, dict) else None
        return state if isinstance(state, str) else ""

    @property
    def age(self) -> float:
        """Return the seconds since the newest news; infinite before the first."""
        return self._clock() - self.told_at

    def trouble(self) -> str:
        """Say why the companion is not known to be well; "" while it is."""
        if self.age > FRESH:
            return SILENT
        return "" if self.state in WELL else self.state or "no state"

    def shown_picture(self) -> _Picture | None:
        """Return the newest picture, None without one that is fresh: an old one must not look live."""
        return self.picture if self.picture_age() <= PICTURE_FRESH else None

    def picture_age(self) -> float:
        """Return the seconds since the newest picture's capture; infinite without one."""
        return self._clock() - self.picture.captured_at if self.picture is not None else float("inf")

    def event(self) -> dict[str, Any]:
        """Return what a page is told: the documents, how old they are, and the state's seconds.

        age: None before the first news. since: seconds of the present state, at least, if `exact` is False.
        """
        return {
            **self.told,
            "age": round(self.age, 2) if self.told else None,
            "since": round(self._clock() - self._since, 1),
            "exact": self._began_here,
        }

    async def more(self, timeout: float) -> None:
        """Wait until something new was told, `timeout` seconds at most."""
        with contextlib.suppress(TimeoutError, asyncio.TimeoutError):
            await asyncio.wait_for(self._changed.wait(), timeout)
