"""Starts the web process, tells it what the companion does, and starts it again: the supervisor's end.

Nothing here waits, and no failure of the page reaches the rest of the daemon.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from companion.config import Config
from companion.config.stopping import lines_of
from companion.observers.page.messages import (
    ALIVE,
    ANSWER,
    LONGEST_SAID,
    SETTINGS_REQUEST,
    WANTED,
    PageMessageKind,
)
from companion.pages.listen import hashed
from companion.system.datagrams import LARGEST, Datagram, decode
from companion.system.side_process import SideChild, SideService, missing_packages
from companion.system.watchdog import Restarts
from companion.tasks import PAGE
from companion.wire.answers import MAX_PAYLOAD, Acknowledgement

log = logging.getLogger(__name__)

COMMAND = (sys.executable, "-m", "companion.observers.page")
_NEEDS = {name: name for name in ("starlette", "uvicorn", "prometheus_client")}
_EVERY = 1.0
"""Seconds between two updates."""
_SOON = 0.2
"""The same after an acknowledgement."""
_WANTED_EVERY = 0.8
"""Seconds between two pictures, at least. The web process asks once a second, with some jitter."""
_BACKLOG = 64


def missing() -> str:
    """Say which packages the page needs and that are not installed, "" where all are."""
    return missing_packages(_NEEDS, "web")


class WebChild(SideChild):
    """Runs `python -m companion.observers.page`."""

    def __init__(self, listener: socket.socket, command: Sequence[str] = COMMAND) -> None:
        """Start the process, which inherits `listener`. Raises OSError."""
        super().__init__(
            command, unit="page", buffer=2 * LARGEST, inherits=[listener.fileno()], longest=LONGEST_SAID + 1
        )


class Page(SideService[WebChild]):
    """Owns the web process. The main loop calls `tell` in every turn."""

    def __init__(
        self,
        config: Config,
        launch: Callable[[socket.socket], WebChild] = WebChild,
        restarts: Restarts = PAGE,
    ) -> None:
        """launch: starts the process with this listening socket or raises OSError. restarts: time limits."""
        self._listen = listen = config.web.address
        off = "switched off by [web] listen" if listen is None else missing()
        super().__init__("page", restarts, off)
        self._setup = Datagram(
            PageMessageKind.SETUP,
            {
                "folder": os.path.abspath(config.journal.path),
                "token_hash": hashed(config.web.token),
                "own_address": listen.host if listen is not None and listen.loopback else "",
                "ground": [{**asdict(line), "labelled": line.labelled} for line in lines_of(config)],
            },
        ).encoded()
        self._launch = launch
        self._listener: socket.socket | None = None
        self._told_at = self._wanted_at = float("-inf")
        self._wanted = self._too_large = self._acknowledged = False
        self._may_answer = bool(config.web.token)
        self.answer: Callable[[bytes, float], None] = lambda _payload, _at: None
        """Takes the payload of an answer that was given on the page, and when it was handed over."""
        self._settings = b""
        self._ask_settings: Callable[[Mapping[str, Any]], None] | None = None
        if off and listen is not None:
            log.warning("no page: %s", off)

    @property
    def url(self) -> str:
        """Where the page is, "" while it is nowhere."""
        return self._listen.url() if self._listen is not None and self.child is not None else ""

    def tell(self, now: float, news: Callable[[], Mapping[str, Any]]) -> None:
        """Keep the process running, take what it says, and tell it the news once a second.

        now: monotonic seconds, here and below. news: makes the content of a `PageMessageKind.NEWS`.
        """
        self.poll(now)
        if self.child is None:
            self._end_listening()
        every = _SOON if self._acknowledged else _EVERY
        if self.child is not None and now - self._told_at >= every:
            self._told_at, self._acknowledged = now, False
            with self._guard.survived("the page", now):
                self.send(Datagram(PageMessageKind.NEWS, {**news(), "at": now}).encoded())

    def wanted(self) -> bool:
        """Whether somebody watches, so that a picture should be drawn; True once a second at most."""
        wanted, self._wanted = self._wanted, False
        return wanted

    def show(self, frame: int, captured_at: float, picture: bytes, from_above: bytes = b"") -> None:
        """Show a drawn frame. captured_at: monotonic seconds. picture: JPEG. from_above: PNG, b"": none."""
        self.send(Datagram(PageMessageKind.MAP, {"at": captured_at}, from_above).encoded())
        try:
            self.send(
                Datagram(PageMessageKind.PICTURE, {"frame": frame, "at": captured_at}, picture).encoded()
            )
        except ValueError as error:
            level = logging.DEBUG if self._too_large else logging.WARNING
            self._too_large = True
            log.log(level, "the page shows no picture: %s", error)

    def acknowledge(self, acknowledgement: Acknowledgement) -> None:
        """Tell the page what became of an answer. The page asks again when it does not hear of it."""
        content = {"payload": acknowledgement.pack().hex()}
        self.send(Datagram(PageMessageKind.ACKNOWLEDGEMENT, content).encoded())
        self._acknowledged = True

    def offer_settings(self, document: Mapping[str, Any], ask: Callable[[Mapping[str, Any]], None]) -> None:
        """Have who has the token see and change settings of the file. Before the first `tell`.

        document: of `PageMessageKind.SETTINGS`. ask: takes a SETTINGS_REQUEST; ValueError: it is nonsense.
        """
        if not self._may_answer:
            return
        try:
            self._settings = Datagram(PageMessageKind.SETTINGS, document).encoded()
        except ValueError as error:
            log.warning("the page shows no settings: %s", error)
        else:
            self._ask_settings = ask

    def tell_settings(self, content: Mapping[str, Any]) -> None:
        """Tell the page what became of a request about settings: a `PageMessageKind.SETTINGS_ANSWER`."""
        self.send(Datagram(PageMessageKind.SETTINGS_ANSWER, content).encoded())

    def figures(self) -> dict[str, Any]:
        """Return where the page is, what is wrong with it, and how often it was started again."""
        return {"url": self.url, "trouble": self.trouble, "restarts": self.restarted}

    def close(self) -> None:
        """Kill the process."""
        super().close()
        self._end_listening()

    def _take(self, said: bytes, now: float) -> bool:
        try:
            kind, content, payload = decode(said)
        except ValueError:
            return False
        at = content.get("at")
        if kind == ANSWER and self._may_answer and isinstance(at, float) and len(payload) <= MAX_PAYLOAD:
            self.answer(payload, at)
        elif kind == SETTINGS_REQUEST and self._ask_settings is not None:
            try:
                self._ask_settings(content)
            except ValueError:
                return False
        elif kind not in (ALIVE, WANTED):
            return False
        if not self.running:
            log.info("the page is on %s", self.url)
        if kind == WANTED and now - self._wanted_at >= _WANTED_EVERY:
            self._wanted_at, self._wanted = now, True
        return True

    def _start(self) -> WebChild:
        """Bind the port and start the process, which alone takes connections. Raises OSError."""
        assert self._listen is not None
        self._end_listening()
        try:
            self._listener = listener = self._listen.bind()
        except OSError as error:
            error.filename = self._listen.url()
            raise
        listener.listen(_BACKLOG)
        child = self._launch(listener)
        # A port that was free is the same one after a restart.
        self._listen = self._listen._replace(port=listener.getsockname()[1])
        child.send(self._setup)
        if self._settings:
            child.send(self._settings)
        return child

    def _end_listening(self) -> None:
        """Free the port, although a process that was killed and has not ended yet has the socket, too."""
        if self._listener is not None:
            with contextlib.suppress(OSError):  # it never listened
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
            self._listener = None
