"""Starts the web process, tells it what the companion does, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the page reaches the rest of the daemon.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any

from companion.config import Config
from companion.system.child_process import ChildProcess
from companion.system.error_guard import ErrorGuard
from companion.system.watchdog import Restarts, Watchdog
from companion.tasks import PAGE
from companion.web.messages import ALIVE, LARGEST, WANTED, Kind, Message

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.web")
EXTRA = 'pip install "anytraverse-companion[web]"'
_NEEDS = ("starlette", "uvicorn", "prometheus_client")
_EVERY = 1.0
"""Seconds between two updates."""
_WANTED_EVERY = 0.8
"""Seconds between two pictures, at least. The web process asks once a second, with some jitter."""
_MOST_SAID = 8
"""Bytes from the web process that are taken in a turn. It sends two a second; more wait, and it blocks."""
_BACKLOG = 64
_REAPED_WITHIN = 0.02


def missing() -> list[str]:
    """Name the packages that the page needs and that are not installed. Imports none of them."""
    return [name for name in _NEEDS if find_spec(name) is None]


class WebChild(ChildProcess):
    """Runs `python -m companion.web`. Messages are sent whole, or dropped when the channel is full."""

    def __init__(self, listener: socket.socket, command: Sequence[str] = COMMAND) -> None:
        """Start the process, which inherits `listener`. Raises OSError."""
        super().__init__(
            command,
            kind=socket.SOCK_SEQPACKET,
            buffer=2 * LARGEST,
            inherits=[listener.fileno()],
            reaped_within=_REAPED_WITHIN,
        )

    def send(self, message: bytes) -> bool:
        """Send a message; False when it is dropped."""
        try:
            return self.channel.send(message) == len(message)
        except OSError:  # full, or the process has died, and `ended` says how
            return False

    def receive(self) -> list[bytes]:
        """Return what it said: messages cut to two bytes, at most `_MOST_SAID` of them."""
        said: list[bytes] = []
        while len(said) < _MOST_SAID:
            try:
                one = self.channel.recv(2)
            except OSError:
                break
            if not one:
                break
            said.append(one)
        return said


class Page:
    """Owns the web process. The main loop calls `poll` in every turn.

    url: where the page is, "" while it is nowhere. trouble: why, in a sentence; "" while all is well.
    """

    def __init__(
        self,
        config: Config,
        launch: Callable[[socket.socket], WebChild] = WebChild,
        restarts: Restarts = PAGE,
    ) -> None:
        """launch: starts the process with this listening socket or raises OSError. restarts: time limits."""
        self._listen = listen = config.web.address
        self._setup = Message(
            Kind.SETUP,
            {
                "folder": os.path.abspath(config.journal.path),
                "token": config.web.token,
                "own_address": listen.host if listen is not None and listen.loopback else "",
            },
        ).encoded()
        self._launch = launch
        self._watchdog: Watchdog[WebChild] = Watchdog(self._start, restarts, "page")
        self._guard = ErrorGuard(lambda _now: None)
        self._told_at = self._wanted_at = float("-inf")
        self._wanted = self._too_large = False
        self.url = ""
        self.trouble = "starting" if self._listen is not None else "switched off by [web] listen"
        if self._listen is not None and (packages := missing()):
            self._listen, self.trouble = None, f"{', '.join(packages)} not installed: {EXTRA}"
            log.warning("no page: %s", self.trouble)

    def poll(self, now: float, news: Callable[[], Mapping[str, Any]]) -> None:
        """Keep the process running, take what it says, and tell it the news once a second.

        now: monotonic seconds, here and below. news: makes the content of a `Kind.NEWS`.
        """
        if self._listen is not None:
            with self._guard.survived("the page", now):
                self._poll(now, news)

    def wanted(self) -> bool:
        """Whether somebody watches, so that a picture should be drawn; True once a second at most."""
        wanted, self._wanted = self._wanted, False
        return wanted

    def show(self, frame: int, captured_at: float, picture: bytes) -> None:
        """Show a drawn frame. captured_at: monotonic seconds. picture: JPEG."""
        child = self._watchdog.child
        if child is None:
            return
        try:
            child.send(Message(Kind.PICTURE, {"frame": frame, "at": captured_at}, picture).encoded())
        except ValueError as error:
            level = logging.DEBUG if self._too_large else logging.WARNING
            self._too_large = True
            log.log(level, "the page shows no picture: %s", error)

    def figures(self) -> dict[str, Any]:
        """Return where the page is, what is wrong with it, and how often it was started again."""
        return {"url": self.url, "trouble": self.trouble, "restarts": self._watchdog.restarted}

    def close(self) -> None:
        """Kill the process."""
        self._watchdog.kill()
        self.url = ""

    def _poll(self, now: float, news: Callable[[], Mapping[str, Any]]) -> None:
        watchdog = self._watchdog
        watchdog.polled(now)
        if watchdog.child is None:
            if watchdog.may_start(now):
                self._try_to_start(now)
            return
        ended = watchdog.child.ended()
        for one in watchdog.child.receive():
            if not self._take(one, now):
                self._restart("sent nonsense", now)
                return
        failure = watchdog.failure(ended, now)
        if failure is not None:
            self._restart(failure.cause, now)
        elif now - self._told_at >= _EVERY:
            self._told_at = now
            watchdog.child.send(Message(Kind.NEWS, {**news(), "at": now}).encoded())

    def _take(self, said: bytes, now: float) -> bool:
        if said not in (ALIVE, WANTED):
            return False
        if not self._watchdog.running:
            self._watchdog.ready(0.0, now)
            self.trouble = ""
            log.info("the page is on %s", self.url)
        self._watchdog.reported(now)
        if said == WANTED and now - self._wanted_at >= _WANTED_EVERY:
            self._wanted_at, self._wanted = now, True
        return True

    def _try_to_start(self, now: float) -> None:
        try:
            self._watchdog.start(now)
        except OSError as error:
            why = (error.strerror or str(error)).lower()
            self._restart(f"cannot be started on {self._where()} ({why})", now)
            return
        assert self._watchdog.child is not None
        self._watchdog.child.send(self._setup)

    def _start(self) -> WebChild:
        """Bind the port and start the process, which alone keeps the socket. Raises OSError."""
        assert self._listen is not None
        with self._listen.bind() as listener:
            listener.listen(_BACKLOG)
            child = self._launch(listener)
            # A port that was free is the same one after a restart.
            self._listen = self._listen._replace(port=listener.getsockname()[1])
        self.url = self._where()
        return child

    def _where(self) -> str:
        return self._listen.url() if self._listen is not None else ""

    def _restart(self, cause: str, now: float) -> None:
        """Have the process started again. What was said already is logged for developers only."""
        again = cause == self.trouble
        self.trouble, self.url = cause, ""
        self._watchdog.restart_later(cause, now, logging.DEBUG if again else logging.WARNING)
