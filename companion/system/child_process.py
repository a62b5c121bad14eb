"""Starts a process with a fresh interpreter that inherits one end of a socket pair, and kills it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

_SET_DEATH_SIGNAL, _SET_DUMPABLE = 1, 4


class ChildProcess:
    """Runs a command, which inherits one descriptor: its end of `channel`. Only `close` may block."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        kind: socket.SocketKind = socket.SOCK_STREAM,
        buffer: int,
        inherits: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
        reaped_within: float,
    ) -> None:
        """Start the process. Raises OSError.

        command: gets the descriptor of its end, those of `inherits` and our process id appended. buffer:
        bytes that may wait in the channel. environment: variables beside our own. reaped_within: seconds that
        `close` waits for the killed process. One in an uninterruptible system call is left to the kernel.
        """
        self._reaped_within = reaped_within
        self.channel, far = socket.socketpair(socket.AF_UNIX, kind)
        for end in (self.channel, far):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, buffer)
        self.channel.settimeout(0)
        descriptors = [far.fileno(), *inherits]
        try:
            self._process = subprocess.Popen(
                [*command, *map(str, descriptors), str(os.getpid())],
                pass_fds=descriptors,
                stdin=subprocess.DEVNULL,
                env={**os.environ, **(environment or {})},
                stdout=subprocess.DEVNULL,  # stderr is inherited, for faulthandler
            )
        except OSError:
            self.channel.close()
            raise
        finally:
            far.close()

    @property
    def pid(self) -> int:
        """Return the process id."""
        return self._process.pid

    def fileno(self) -> int | None:
        """Return the channel's descriptor; None after `close`."""
        return self.channel.fileno() if self.channel.fileno() >= 0 else None

    def ended(self) -> str:
        """Say how the process ended, in two or three words; "" while it runs."""
        code = self._process.poll()
        if code is None:
            return ""
        if code >= 0:
            return f"exit code {code}"
        with contextlib.suppress(ValueError):
            return signal.Signals(-code).name
        return f"signal {-code}"

    def cpu_seconds(self) -> float:
        """Return for how long the process has computed, 0.0 for one that has ended and gone."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def ends_within(self, seconds: float) -> bool:
        """Wait for the process to end by itself. Whether it did."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def close(self) -> None:
        """Kill the process in whatever state it is, and close the channel. May be called repeatedly."""
        if self._process.returncode is None:
            self._process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):  # a camera driver may delay its end
                self._process.wait(self._reaped_within)
        self.channel.close()


def end_with(parent: int) -> None:
    """Have the kernel kill this process when `parent`, which started it, dies."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the call of prctl
        os._exit(0)


def shut_out() -> None:
    """Let no other process of this user read or write our memory, or take our descriptors; root still may.

    A process that we start by its own program is open again.
    """
    ctypes.CDLL(None).prctl(_SET_DUMPABLE, 0)


def step_back(niceness: int, first_out: int) -> None:
    """Lower this process's priority, and have the kernel kill it before others when memory runs out.

    first_out: oom_score_adj, 0 to 1000.
    """
    os.nice(niceness)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(str(first_out), encoding="ascii")
