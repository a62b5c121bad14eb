"""Processes that a thread starts beside the main loop, whatever the disk does, and that end with us."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.faults.disk import FailingDisk
from companion.system.child_process import ChildProcess
from companion.system.side_process import SideChild
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 20.0
_SAYS = (
    "import socket, sys\n"
    "channel = socket.socket(fileno=int(sys.argv[1]))\n"
    "channel.send(b'said ' + channel.recv(9))\n"
    "channel.recv(1)"
)


def start(program: str, *command: str, inherits: list[int] | None = None) -> SideChild:
    """Start Python on this program."""
    command = command or (sys.executable, "-c", program)
    return SideChild(command, buffer=1 << 16, inherits=inherits or [], longest=64)


def until(fits: Callable[[], object]) -> None:
    """Wait for it."""
    wait_for(fits, PATIENCE)


def wait(child: ChildProcess) -> str:
    """How it ended."""
    until(child.ended)
    return child.ended()


def failure(child: ChildProcess) -> OSError:
    """Why it could not be started."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            child.ended()
        except OSError as error:
            return error
        time.sleep(0.01)
    raise AssertionError("it was started")


_LOOP = """
import sys, time
from tests.companion.system.test_child_process import _SAYS, start
child = start(_SAYS)
child.send(b"hello")
time.sleep(0.2)
print("turns", child.pid, child.ended(), flush=True)
while not (said := child.receive()):
    time.sleep(0.01)
print(said[0].decode(), flush=True)
child.close()
"""


@pytest.mark.slow
def test_the_main_loop_turns_while_the_disk_does_not_give_the_program(tmp_path: Path) -> None:
    try:
        disk = FailingDisk(tmp_path, tmp_path / "state")
    except RuntimeError as error:
        pytest.skip(str(error))
    with subprocess.Popen(
        [sys.executable, "-c", _LOOP],
        env={**os.environ, **disk.environment, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    ) as loop:
        disk.set("dead")
        late = threading.Timer(PATIENCE, disk.set, [""])
        late.start()
        assert loop.stdout is not None
        turned = loop.stdout.readline()
        disk_hung = late.is_alive()
        late.cancel()
        disk.set("")
        assert turned == "turns None \n"
        assert disk_hung
        assert loop.stdout.readline() == "said hello\n"
    assert loop.returncode == 0


def test_what_is_sent_before_it_is_started_reaches_it_and_the_caller_may_close_what_it_gave() -> None:
    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            child = start(
                "import socket, sys; socket.socket(fileno=int(sys.argv[2])).send(sys.argv[3].encode())",
                inherits=[theirs.fileno()],
            )
        ours.settimeout(PATIENCE)
        assert ours.recv(64) == str(os.getpid()).encode()
    assert wait(child) == "exit code 0"
    child.close()


def test_one_that_cannot_be_started_says_so_when_it_is_asked() -> None:
    child = start("", "/nowhere/python")
    assert "/nowhere/python" in str(failure(child))
    with pytest.raises(FileNotFoundError):
        child.ended()
    child.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_it_says_which_signal_ended_it(number: signal.Signals) -> None:
    child = start("import time; time.sleep(60)")
    until(lambda: child.pid)
    assert child.pid is not None
    os.kill(child.pid, number)
    assert wait(child) == number.name
    child.close()


def test_one_that_is_closed_while_it_is_being_started_is_killed_once_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started, real = threading.Event(), subprocess.Popen

    def late(*given: object, **named: object) -> object:
        assert started.wait(PATIENCE)
        return real(*given, **named)  # type: ignore[call-overload]

    monkeypatch.setattr(subprocess, "Popen", late)
    child = start("import time; time.sleep(60)")
    child.close()
    assert (child.pid, child.fileno()) == (None, None)
    started.set()
    assert wait(child) == "SIGKILL"
    assert child.ends_within(PATIENCE)


@pytest.mark.parametrize(("parent", "said"), [(0, b"goes on"), (-1, b"")])
def test_one_whose_parent_is_gone_already_ends_and_one_that_systemd_started_goes_on(
    parent: int, said: bytes
) -> None:
    child = start(
        f"from companion.system.child_process import end_with; end_with({parent})\n"
        "import socket, sys; socket.socket(fileno=int(sys.argv[1])).send(b'goes on')"
    )
    child.channel.settimeout(PATIENCE)
    assert child.channel.recv(64) == said
    child.close()


def test_it_lives_longer_than_the_thread_that_asked_for_it() -> None:
    made: list[SideChild] = []
    program = (
        "import sys; from companion.system.child_process import end_with\n"
        "import socket; channel = socket.socket(fileno=int(sys.argv[1])); end_with(int(sys.argv[2]))\n"
        "channel.send(b'ready'); channel.recv(1); channel.send(b'still here')"
    )
    asks = threading.Thread(target=lambda: made.append(start(program)))
    asks.start()
    asks.join()
    (child,) = made
    child.channel.settimeout(PATIENCE)
    assert child.channel.recv(64) == b"ready"
    child.send(b"?")
    assert child.channel.recv(64) == b"still here"
    assert wait(child) == "exit code 0"
    child.close()
