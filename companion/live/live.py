"""Starts the live view's process, sends it what is recorded, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the live view reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from typing import Any

from companion.browser.listen import Listen
from companion.config import Config
from companion.live.messages import LONGEST_REPORT, Report
from companion.recording.feed import BUFFER, Feed
from companion.recording.messages import Message
from companion.system.side_process import SideChild, SideProcess
from companion.system.watchdog import Restarts
from companion.tasks import LIVE

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.live")
EXTRA = 'pip install "anytraverse-companion[live]"'


def missing() -> list[str]:
    """Name the packages that the live view needs and that are not installed. Imports none of them."""
    return [] if find_spec("foxglove") else ["foxglove-sdk"]


class LiveChild(SideChild):
    """Runs `python -m companion.live`."""

    def __init__(self, listen: Listen, command: Sequence[str] = COMMAND) -> None:
        """Start the process. listen: where it does. Raises OSError."""
        where = listen.host, str(listen.port)
        super().__init__(command, where, unit="live", buffer=BUFFER, longest=LONGEST_REPORT + 1)


class Live:
    """Owns the live view's process. The main loop calls `poll` in every turn."""

    def __init__(
        self,
        config: Config,
        launch: Callable[[Listen], LiveChild] = LiveChild,
        restarts: Restarts = LIVE,
    ) -> None:
        """launch: starts the process that listens there or raises OSError. restarts: time limits."""
        self._listen = config.live.address
        self._launch = launch
        self._feed: Feed[LiveChild] = Feed("live view", self._start, restarts)
        self._clients = 0
        if self._listen is None:
            self._process.trouble = "switched off by [live] listen"
        elif packages := missing():
            self._listen, self._process.trouble = None, f"{', '.join(packages)} not installed: {EXTRA}"
            log.warning("no live view: %s", self._process.trouble)

    @property
    def listener(self) -> int:
        """The number of the process for which messages should be made, 0: there is none."""
        return self._feed.listener

    def poll(self, now: float, messages: Iterable[Message] = ()) -> None:
        """Keep the process running, take what it says, and send it messages. now: monotonic seconds."""
        if self._listen is not None:
            self._feed.poll(now, messages, self._take)

    def figures(self) -> dict[str, Any]:
        """Return where it is, how many see it, what is wrong, and how much was lost since the start."""
        process, running = self._process, self._process.running
        return {
            "url": self._listen.url("ws") if self._listen is not None and running else "",
            "clients": self._clients if running else 0,
            "trouble": process.trouble,
            "restarts": process.restarted,
            "lost": self._feed.lost,
        }

    def close(self) -> None:
        """Kill the process."""
        self._process.close()

    @property
    def _process(self) -> SideProcess[LiveChild]:
        return self._feed.process

    def _take(self, said: bytes, _now: float) -> bool:
        try:
            told = Report.decoded(said)
        except ValueError:
            return False
        if self._listen is None or self._listen.port not in (0, told.port):
            return False
        if not self._process.running:
            # A port that was free is the same one after a restart.
            self._listen = self._listen._replace(port=told.port)
            log.info("the live view is on %s", self._listen.url("ws"))
        self._clients = told.clients
        return True

    def _start(self) -> LiveChild:
        """Start the process where the port is free. Raises OSError."""
        assert self._listen is not None
        try:
            self._listen.bind().close()
        except OSError as error:
            error.filename = self._listen.url("ws")
            raise
        return self._launch(self._listen)
