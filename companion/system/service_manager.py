"""Reports to systemd (sd_notify), and waits before a start that follows failures."""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from companion.system.log_lines import unread_stderr
from companion.system.watchdog import back_off

log = logging.getLogger(__name__)

_FIRST_PAUSE, LONGEST_PAUSE = 2.0, 59.0
"""Seconds that follow two failures, and at most. With the unit's RestartSec of 1 s that makes up to 60 s
between two starts."""
STEADY_AFTER = 10.0
"""Seconds of running after which earlier failures no longer count."""
_FAILURES = "failures"
_EXTENSION = 30.0
_EXTEND_EVERY = 1.0
_LEAVE_WITHIN = 15.0


class ServiceManager:
    """Sends what systemd wants to know, as datagrams to $NOTIFY_SOCKET. Without it, it is silent.

    In a container nobody hears it: with $WATCHDOG_USEC alone the process watches itself. When it is ready
    and was not `alive` for so long, it says on stderr where each thread is, and ends with 1.
    Nothing here blocks, except `pause`. While the daemon starts, call `starting` in every turn, then `ready`
    once, then `alive` in every sound turn, then `stopping`.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """environment: $NOTIFY_SOCKET, $WATCHDOG_USEC, $WATCHDOG_PID and $RUNTIME_DIRECTORY, all optional."""
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket: socket.socket | None = None
        if path.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.settimeout(0)
        folder = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
        self._failures = Path(folder, _FAILURES) if folder else None
        self._period = _watchdog_period(environment)
        self._stderr = unread_stderr() if self._socket is None and self._period else None
        self._due = float("-inf")
        self._steady_at = float("inf")
        self._status = ""
        self._ready_sent = True
        self._send_failed = False

    def pause(self, stop: Callable[[], bool]) -> None:
        """Wait before a start that follows failures, until `stop()` at the latest: 0, 2, 4 ... 59 s.

        systemd's own rising delay (RestartSteps=) needs its version 254, and never becomes short again.
        """
        failures = self._read_failures()
        seconds = back_off(failures - 1, _FIRST_PAUSE, LONGEST_PAUSE)
        self._write_failures(failures + 1)
        if not seconds:
            return
        log.warning("failed %d times in a row: starts in %.0f s", failures, seconds)
        self._send(f"EXTEND_TIMEOUT_USEC={_microseconds(seconds + _EXTENSION)}")
        self.status(f"failed {failures} times in a row: waits {seconds:.0f} s before it starts")
        until = time.monotonic() + seconds
        while not stop() and time.monotonic() < until:
            time.sleep(0.1)

    def starting(self, now: float) -> None:
        """Ask for more time to start. now: monotonic seconds, here and below."""
        if now >= self._due:
            self._due = now + _EXTEND_EVERY
            self.status("starting: the perceiver is loading")
            self._send(f"EXTEND_TIMEOUT_USEC={_microseconds(_EXTENSION)}")

    def ready(self, now: float) -> None:
        """Report that the start is over: the watchdog counts from now on."""
        self._ready_sent = self._send("READY=1")
        self._watch(self._period)
        self._due = now
        self._steady_at = now + STEADY_AFTER

    def alive(self, now: float) -> None:
        """Keep the watchdog from killing this process. Call it only if all is well or a fault is reported."""
        if self._period is not None and now >= self._due:
            self._due = now + self._period / 4
            self._ready_sent = self._ready_sent or self._send("READY=1")
            self._send("WATCHDOG=1")
            self._watch(self._period)
        if now >= self._steady_at:
            self._steady_at = float("inf")
            self._write_failures(0)

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """Report an orderly end, which is no failure. It may take longer than the watchdog's period."""
        self._send(f"STOPPING=1\nWATCHDOG=1\nWATCHDOG_USEC={_microseconds(_LEAVE_WITHIN)}")
        self._watch(_LEAVE_WITHIN)
        self._write_failures(0)

    def _watch(self, seconds: float | None) -> None:
        """End this process after so long unless called again, also while Python's lock is held."""
        if self._stderr is not None and seconds is not None:
            faulthandler.dump_traceback_later(seconds, exit=True, file=self._stderr)

    def _send(self, line: str) -> bool:
        if self._socket is None:
            return True
        try:
            self._socket.sendto(line.encode(), self._address)
            self._send_failed = False
        except OSError as error:
            if not self._send_failed:
                log.warning("systemd does not take %s: %s", line, error)
            self._send_failed = True
        return not self._send_failed

    def _read_failures(self) -> int:
        if self._failures is None:
            return 0
        try:
            return max(0, int(self._failures.read_text(encoding="ascii")[:6]))
        except (OSError, ValueError):
            return 0

    def _write_failures(self, number: int) -> None:
        if self._failures is None:
            return
        try:
            self._failures.write_text(str(number), encoding="ascii")
        except OSError as error:
            log.warning("restarts are not counted: %s", error)


def stop_on_signals() -> Callable[[], bool]:
    """Catch SIGTERM and SIGINT. The returned function says whether one of them came."""
    signals_caught: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda caught, _: signals_caught.append(caught))
    return lambda: bool(signals_caught)


def _watchdog_period(environment: Mapping[str, str]) -> float | None:
    """Return the seconds within which systemd wants a sign of life, None without a watchdog for us."""
    try:
        period = int(environment["WATCHDOG_USEC"]) / 1e6
        ours = int(environment.get("WATCHDOG_PID", os.getpid())) == os.getpid()
    except (KeyError, ValueError):
        return None
    return period if ours and period > 0.0 else None


def _microseconds(seconds: float) -> int:
    return round(1e6 * seconds)
