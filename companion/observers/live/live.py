"""Starts the live view's process, sends it what is recorded, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the live view reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Sequence
from typing import Any

from companion.config import Config
from companion.observers.recording.feed import BUFFER, FedService
from companion.pages.listen import Listen
from companion.system.datagrams import decode
from companion.system.side_process import SideChild, missing_packages
from companion.system.watchdog import Restarts
from companion.tasks import LIVE
from companion.wire.json_values import whole_of

log = logging.getLogger(__name__)

_LONGEST_REPORT = 64
COMMAND = (sys.executable, "-m", "companion.observers.live")


def missing() -> str:
    """Say which packages the live view needs and that are not installed, "" where all are."""
    return missing_packages({"foxglove": "foxglove-sdk"}, "live")


class LiveChild(SideChild):
    """Runs `python -m companion.observers.live`."""

    def __init__(self, listen: Listen, command: Sequence[str] = COMMAND) -> None:
        """Start the process. listen: where it does. Raises OSError."""
        where = listen.host, str(listen.port)
        super().__init__(command, where, unit="live", buffer=BUFFER, longest=_LONGEST_REPORT)


class Live(FedService[LiveChild]):
    """Owns the live view's process. The main loop calls `poll` in every turn."""

    def __init__(
        self, config: Config, launch: Callable[[Listen], LiveChild] = LiveChild, restarts: Restarts = LIVE
    ) -> None:
        """launch: starts the process that listens there or raises OSError. restarts: time limits."""
        self._listen = config.live.address
        off = "switched off by [live] listen" if self._listen is None else missing()
        super().__init__("live view", restarts, off)
        self._launch = launch
        self._clients = 0
        if off and self._listen is not None:
            log.warning("no live view: %s", off)

    def figures(self) -> dict[str, Any]:
        """Return where it is, how many see it, what is wrong, and how much was lost since the start."""
        return {
            "url": self._listen.url("ws") if self._listen is not None and self.running else "",
            "clients": self._clients if self.running else 0,
            "trouble": self.trouble,
            "restarts": self.restarted,
            "lost": self.lost,
        }

    def _take(self, said: bytes, _now: float) -> bool:
        try:
            told = decode(said).content
        except ValueError:
            return False
        port, clients = whole_of(told.get("port"), 1, 0xFFFF), whole_of(told.get("clients"), 0, 0xFFFF)
        if port is None or clients is None or self._listen is None or self._listen.port not in (0, port):
            return False
        if not self.running:
            # A port that was free is the same one after a restart.
            self._listen = self._listen._replace(port=port)
            log.info("the live view is on %s", self._listen.url("ws"))
        self._clients = clients
        return True

    def _start_fed(self) -> LiveChild:
        """Start the process where the port is free. Raises OSError."""
        assert self._listen is not None
        try:
            self._listen.bind().close()
        except OSError as error:
            error.filename = self._listen.url("ws")
            raise
        return self._launch(self._listen)
