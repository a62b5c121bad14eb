"""Processes that systemd starts at a socket: here a small stand-in for it does, as our own user."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from companion.system import socket_units
from companion.system.side_process import SideChild
from companion.system.socket_units import SocketUnit, arguments
from companion.vision.child import VisionChild
from tests.companion.system.test_child_process import PATIENCE, failure, until, wait

ROOT = Path(__file__).resolve().parents[3]
_ECHO = """
import os, socket, sys, time
from companion.system.socket_units import arguments
*given, channel, parent = arguments()
channel = socket.socket(fileno=int(channel))
channel.send(" ".join([*given, parent]).encode())
while said := channel.recv(64):
    if said == b"close":
        os.close(3)
    if said == b"shutdown":
        socket.socket(fileno=os.dup(3)).shutdown(socket.SHUT_RDWR)
    channel.send(b"heard " + said)
"""


class ServiceManager:
    """Starts a program at each connection, and kills what it has started when the file is there."""

    def __init__(self, folder: Path, name: str, program: str) -> None:
        self._program, self._doomed = program, folder / f"kill-{name}"
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(str(folder / name))
        self._listener.listen()
        self.running: list[tuple[subprocess.Popen[bytes], socket.socket]] = []
        self.kills = True
        self._ending = threading.Event()
        self._threads = [threading.Thread(target=one) for one in (self._accept, self._turn)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._ending.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for process, connection in self.running:
            process.kill()
            process.wait()
            connection.close()
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while not self._ending.is_set():
                connection, _ = self._listener.accept()
                command = [
                    "sh",
                    "-c",
                    'LISTEN_PID=$$ exec "$@" 3<&0',
                    "sh",
                    sys.executable,
                    "-c",
                    self._program,
                ]
                environment = {**os.environ, "LISTEN_FDS": "1"}
                process = subprocess.Popen(command, stdin=connection.fileno(), cwd=ROOT, env=environment)
                self.running.append((process, connection))

    def _turn(self) -> None:
        while not self._ending.wait(0.01):
            if self.kills and self._doomed.exists():
                for process, _ in self.running:
                    process.kill()
                self._doomed.unlink()
            for one in [one for one in self.running if one[0].poll() is not None]:
                self.running.remove(one)
                one[1].close()


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServiceManager]:
    monkeypatch.setenv(socket_units.SOCKETS, str(tmp_path))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    manager = ServiceManager(tmp_path, "echo", _ECHO)
    yield manager
    manager.close()


def start(*given: str) -> SideChild:
    return SideChild(["/nowhere"], given, unit="echo", buffer=1 << 16, longest=64)


def heard(child: SideChild) -> bytes:
    said: list[bytes] = []

    def more() -> bool:
        said.extend(child.receive())
        return bool(said)

    until(more)
    return b"|".join(said)


def test_it_gets_its_arguments_and_what_was_sent_before_it_was_started(manager: ServiceManager) -> None:
    child = start("one", "two words")
    child.send(b"hello")
    answers = heard(child)
    if answers == b"one two words 0":
        answers += b"|" + heard(child)
    assert answers == b"one two words 0|heard hello"
    assert (child.ended(), child.pid) == ("", None)
    child.close()
    until(lambda: not manager.running)


@pytest.mark.usefixtures("manager")
def test_one_that_ends_by_itself_is_said_to_have_ended() -> None:
    child = start()
    heard(child)
    child.channel.shutdown(socket.SHUT_WR)
    assert wait(child) == "its unit ended"
    assert child.ends_within(PATIENCE)
    child.close()


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_one_that_hangs_or_was_killed_makes_room_for_the_next(
    manager: ServiceManager, number: signal.Signals
) -> None:
    first = start("first")
    heard(first)
    process, _ = manager.running[0]
    process.send_signal(number)
    first.close()
    second = start("second")
    assert heard(second) == b"second 0"
    assert process.poll() == -signal.SIGKILL
    second.close()


def test_one_that_closes_systemds_socket_is_not_taken_for_one_that_has_ended(manager: ServiceManager) -> None:
    child = start()
    heard(child)
    child.send(b"close")
    assert heard(child) == b"heard close"
    time.sleep(0.1)
    assert child.ended() == ""
    assert manager.running
    child.close()


def test_one_that_feigns_its_end_is_killed_all_the_same(manager: ServiceManager) -> None:
    child = start()
    heard(child)
    child.send(b"shutdown")
    assert wait(child) == "its unit ended"
    assert manager.running
    child.close()
    until(lambda: not manager.running)


def test_nothing_is_started_beside_one_that_systemd_does_not_end(
    manager: ServiceManager, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket_units, "_WITHIN", 0.2)
    first = start("first")
    heard(first)
    manager.kills = False
    second = start("second")
    assert "systemctl status anytraverse-kill@echo.path" in str(failure(second))
    assert len(manager.running) == 1
    manager.kills = True
    for child in (second, first):
        child.close()


@pytest.mark.usefixtures("manager")
def test_a_socket_that_is_not_there_is_said(tmp_path: Path) -> None:
    (tmp_path / "echo").unlink()
    child = start()
    assert isinstance(failure(child), FileNotFoundError)
    child.close()


def test_it_is_our_child_where_systemd_has_no_socket_for_us(
    manager: ServiceManager, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY")
    assert SocketUnit.of("echo") is None
    child = SideChild(
        [sys.executable, "-c", "import time; time.sleep(60)"], unit="echo", buffer=1 << 16, longest=9
    )
    until(lambda: child.pid)
    child.close()
    assert wait(child) == "SIGKILL"
    assert not manager.running


def test_the_vision_process_gets_a_network_only_where_its_camera_needs_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(socket_units.SOCKETS, str(tmp_path))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    managers = {name: ServiceManager(tmp_path, name, _ECHO) for name in ("vision", "network-vision")}
    try:
        for network, name in ((False, "vision"), (True, "network-vision")):
            child = VisionChild(network=network)
            until(partial(bool, managers[name].running))
            child.close()
            assert [bool(one.running) for one in managers.values()].count(True) <= 1
    finally:
        for manager in managers.values():
            manager.close()


def test_without_a_socket_the_arguments_are_those_of_the_command_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", ["program", "3", "4"])
    assert arguments() == ["3", "4"]
    monkeypatch.setenv("LISTEN_FDS", "1")
    monkeypatch.setenv("LISTEN_PID", str(os.getpid() + 1))  # it was meant for the process that started us
    assert arguments() == ["3", "4"]
