"""Starts a process that gets one end of a socket pair, and kills it."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from companion.system.log_lines import log_to_stderr
from companion.system.socket_units import SocketUnit, arguments

log = logging.getLogger(__name__)

# Python before 3.11.4 keeps its lock after vfork() until the program is read, which a disk may delay.
subprocess._USE_VFORK = False  # type: ignore[misc]
_SET_DEATH_SIGNAL, _SET_DUMPABLE = 1, 4


class _Subprocess:
    """Runs a command as a child of the thread that calls `run`: the kernel kills it when that thread ends."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None
        self._reaping = threading.Lock()

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def run(self, arguments: Sequence[str], descriptors: Sequence[int]) -> None:
        self._process = subprocess.Popen(
            [*self._command, *arguments, *map(str, descriptors), str(os.getpid())],
            pass_fds=descriptors,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,  # stderr is inherited, for faulthandler
        )

    def wait(self) -> str:
        assert self._process is not None
        with contextlib.suppress(ChildProcessError):  # `kill` has reaped it
            os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT)
        with self._reaping:  # so that no other process with its number is killed
            code = self._process.wait()
        if code >= 0:
            return f"exit code {code}"
        with contextlib.suppress(ValueError):
            return signal.Signals(-code).name
        return f"signal {-code}"

    def kill(self, number: signal.Signals = signal.SIGKILL) -> None:
        with self._reaping:
            if self._process is not None and self._process.returncode is None:
                self._process.send_signal(number)


class ChildProcess:
    """Runs a program, which gets one descriptor: its end of `channel`. Only `close` may block.

    systemd starts the program where it has a socket unit for it, as another user: then nothing reaches us but
    what comes through the channel. Elsewhere it is our child. A thread has it started, since reading the
    program may wait for a disk, and lives as long as the process.
    """

    def __init__(
        self,
        command: Sequence[str],
        arguments: Sequence[str] = (),
        *,
        unit: str = "",
        kind: socket.SocketKind = socket.SOCK_STREAM,
        buffer: int,
        inherits: Sequence[int] = (),
        reaped_within: float,
    ) -> None:
        """Have the process started; what is sent meanwhile waits in the channel. Raises OSError.

        command: starts our child. arguments: of the program, which gets the descriptor of its end, those of
        `inherits` and the process id of its parent appended (`socket_units.arguments`). unit: of
        `SocketUnit`, "": it is always our child. inherits: the caller may close them at once. buffer: bytes
        that may wait in the channel. reaped_within: seconds that `close` waits for the killed process. One in
        an uninterruptible system call is left to the kernel.
        """
        self._program = SocketUnit.of(unit) or _Subprocess(command)
        self._arguments = arguments
        self._reaped_within = reaped_within
        self._changing = threading.Lock()
        self._started = self._killed = False
        self._failure: OSError | None = None
        self._ended = ""
        self._given: list[int] = []
        """Descriptors for the process alone."""
        self._thread = threading.Thread(target=self._run, name="child", daemon=True)
        self.channel, far = socket.socketpair(socket.AF_UNIX, kind)
        try:
            with far:
                for end in (self.channel, far):
                    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, buffer)
                self.channel.settimeout(0)
                for descriptor in (far.fileno(), *inherits):
                    self._given.append(os.dup(descriptor))
            self._thread.start()
        except (OSError, RuntimeError) as error:  # RuntimeError: no more threads
            self._close_given()
            self.channel.close()
            raise error if isinstance(error, OSError) else OSError(str(error)) from error

    @property
    def pid(self) -> int | None:
        """Return the process id of our child; None before it is started, and where systemd starts it."""
        return self._program.pid if isinstance(self._program, _Subprocess) else None

    def fileno(self) -> int | None:
        """Return the channel's descriptor; None after `close`."""
        return self.channel.fileno() if self.channel.fileno() >= 0 else None

    def ended(self) -> str:
        """Say how the process ended, in two or three words; "" while it runs or is being started.

        Raises OSError where it could not be started.
        """
        if self._failure is not None:
            raise self._failure
        return self._ended

    def cpu_seconds(self) -> float:
        """Return for how long our child has computed, 0.0 for one that has ended and gone."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def ends_within(self, seconds: float) -> bool:
        """Wait for the process to end by itself. Whether it did."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def terminate(self) -> None:
        """Ask our child to end in order (SIGTERM). One that has not started yet is killed when it does."""
        with self._changing:
            if self._started and isinstance(self._program, _Subprocess):
                self._program.kill(signal.SIGTERM)
            else:
                self._killed = True

    def close(self) -> None:
        """Kill the process in whatever state it is, and close the channel. May be called repeatedly."""
        with self._changing:
            self._killed = True
            if self._started:  # also one that seems to have ended: it may say so itself
                self._kill()
        self._thread.join(self._reaped_within)  # a camera driver, or a disk, may delay its end
        self.channel.close()

    def _run(self) -> None:
        try:
            self._program.run(self._arguments, self._given)
        except OSError as error:
            self._failure = error
            return
        finally:
            self._close_given()
        with self._changing:
            self._started = True
            if self._killed:
                self._kill()
        self._ended = self._program.wait()

    def _kill(self) -> None:
        try:
            self._program.kill()
        except OSError as error:  # the next start asks for it again
            log.error("a process cannot be ended: %s", error)

    def _close_given(self) -> None:
        for descriptor in self._given:
            os.close(descriptor)


def begin(count: int, *, niceness: int, first_out: int) -> list[str]:
    """Begin a process that the supervisor starts: end with it, and step back for it. Return its arguments.

    count: of arguments and descriptors. It is called before the imports, which keep a small computer busy
    for a second. Exits where a person has typed the command.
    """
    given = arguments()
    if len(given) != count + 1:
        sys.exit("this process is started by `companion run`: type that")
    end_with(int(given.pop()))
    step_back(niceness, first_out)
    return given


def settle_in(memory: int, **limits: int) -> None:
    """Prepare a process for its work: limit what it takes, leave its end to the supervisor, log to stderr.

    memory: bytes of data, at most. limits: further ones, such as NOFILE.
    """
    for name, most in {"DATA": memory, **limits}.items():
        with contextlib.suppress(OSError, ValueError):  # this computer's limit is lower
            resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))
    for number in (signal.SIGINT, signal.SIGTERM):  # the supervisor says when to end
        signal.signal(number, signal.SIG_IGN)
    log_to_stderr(logging.WARNING)


def end_with(parent: int) -> None:
    """Have the kernel kill this process when `parent`, which started it, dies, or the thread that did.

    parent: 0 where systemd started it: then it ends when the channel does, and systemd kills it.
    """
    if not parent:
        return
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
