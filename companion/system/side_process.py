"""Runs a process that the daemon can do without: nothing waits for it, and none of its failures spreads."""

from __future__ import annotations

import logging
import socket
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Generic, TypeVar

from anytraverse.release import to_install
from companion.system.child_process import ChildProcess
from companion.system.error_guard import ErrorGuard
from companion.system.watchdog import Restarts, Watchdog

log = logging.getLogger(__name__)

_MOST_SAID = 8
"""Datagrams of the process that are taken in a turn. It sends a few a second; more wait, and it blocks."""
_REAPED_WITHIN = 0.02


class SideChild(ChildProcess):
    """Exchanges datagrams with a process. One is sent whole, or dropped when too many wait."""

    def __init__(
        self,
        command: Sequence[str],
        arguments: Sequence[str] = (),
        *,
        unit: str = "",
        buffer: int,
        inherits: Sequence[int] = (),
        longest: int,
    ) -> None:
        """Start the process. longest: of `receive`. All else: of `ChildProcess`. Raises OSError."""
        super().__init__(
            command,
            arguments,
            unit=unit,
            kind=socket.SOCK_SEQPACKET,
            buffer=buffer,
            inherits=inherits,
            reaped_within=_REAPED_WITHIN,
        )
        self._longest = longest

    def send(self, message: bytes) -> bool:
        """Send a message; False when it is dropped."""
        try:
            return self.channel.send(message) == len(message)
        except OSError:  # full, or the process has died, and `ended` says how
            return False

    def receive(self) -> list[bytes]:
        """Return what it said: messages cut to `longest` bytes, eight of them at most."""
        said, resets = list[bytes](), 0
        while len(said) < _MOST_SAID and resets <= 1:
            try:
                one = self.channel.recv(self._longest)
            except ConnectionResetError:
                # It ended with something unread: the kernel says so once, before what it has said itself.
                resets += 1
                continue
            except OSError:
                break
            if not one:
                break
            said.append(one)
        return said


_Child = TypeVar("_Child", bound=SideChild)


class SideService(ABC, Generic[_Child]):
    """Has a process that the daemon can do without: starts it, watches it, and starts it again.

    It runs from its first message on. No failure of it reaches the rest of the daemon. A service says how its
    process is started (`_start`) and takes what the process says (`_take`).

    trouble: why it does not run, in a sentence; "" while all is well.
    """

    def __init__(self, name: str, restarts: Restarts, off: str = "") -> None:
        """name: for the log. restarts: time limits. off: why no process is ever started, "" otherwise."""
        self._name = name
        self._off = bool(off)
        self.trouble = off or "starting"
        self._watchdog: Watchdog[_Child] = Watchdog(self._start, restarts, name)
        self._guard = ErrorGuard(lambda _now: None)

    @property
    def child(self) -> _Child | None:
        """The process, None while there is none."""
        return self._watchdog.child

    @property
    def restarted(self) -> int:
        """How often it was killed or had died."""
        return self._watchdog.restarted

    @property
    def running(self) -> bool:
        """Whether it was heard since its start."""
        return self._watchdog.running

    def poll(self, now: float) -> None:
        """Start the process when it is due, and hear what it says. now: monotonic seconds."""
        if not self._off:
            with self._guard.survived(f"the {self._name}", now):
                self._poll(now)

    def send(self, message: bytes) -> bool:
        """Send a message; False when it is dropped, or there is no process."""
        return self.child is not None and self.child.send(message)

    def close(self) -> None:
        """Kill the process."""
        self._watchdog.kill()

    @abstractmethod
    def _start(self) -> _Child:
        """Have the process started, and give it its setup. Raises OSError."""

    @abstractmethod
    def _take(self, said: bytes, now: float) -> bool:
        """Take a message; False for one that is not understood: then the process is started again."""

    def _poll(self, now: float) -> None:
        watchdog = self._watchdog
        watchdog.polled(now)
        if watchdog.child is None:
            if watchdog.may_start(now):
                self._try_to_start(now)
            return
        try:
            ended = watchdog.child.ended()
        except OSError as error:
            self._not_started(error, now)
            return
        for one in watchdog.child.receive():
            if not self._take(one, now):
                self._restart("sent nonsense", now)
                return
            if not watchdog.running:
                watchdog.ready(0.0, now)
                self.trouble = ""
            watchdog.reported(now)
        failure = watchdog.failure(ended, now)
        if failure is not None:
            self._restart(failure.cause, now)

    def _try_to_start(self, now: float) -> None:
        try:
            self._watchdog.start(now)
        except OSError as error:
            self._not_started(error, now)

    def _not_started(self, error: OSError, now: float) -> None:
        why = (error.strerror or str(error)).lower()
        where = f" on {error.filename}" if error.filename else ""
        self._restart(f"cannot be started{where} ({why})", now)

    def _restart(self, cause: str, now: float) -> None:
        """Have the process started again. What was said already is logged for developers only."""
        again = cause == self.trouble
        self.trouble = cause
        self._watchdog.restart_later(cause, now, logging.DEBUG if again else logging.WARNING)


def missing_packages(modules: Mapping[str, str], extra: str) -> str:
    """Say which packages are not installed, and what to type; "" where all are. Imports none of them.

    modules: module -> the package that brings it. extra: of this project, with all of them.
    """
    absent = [package for module, package in modules.items() if find_spec(module) is None]
    return f"{', '.join(absent)} not installed: {to_install(extra)}" if absent else ""
