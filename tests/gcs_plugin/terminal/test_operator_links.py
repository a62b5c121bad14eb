"""The byte pipes to a link, over loopback and a pseudo terminal."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.wire import devices
from gcs_plugin.terminal import connection as streams
from gcs_plugin.terminal import lookup
from gcs_plugin.terminal.connection import (
    MAX_PEERS,
    LinkError,
    OperatorConnection,
    UdpConnection,
    open_connection,
)
from tests.waiting import wait_for

DEADLINE_S = 10.0


@pytest.fixture
def opened() -> Iterator[Callable[[str], OperatorConnection]]:
    connections: list[OperatorConnection] = []

    def opening(link: str) -> OperatorConnection:
        connections.append(open_connection(link))
        return connections[-1]

    yield opening
    for connection in connections:
        connection.close()


def read_until(connection: OperatorConnection, wanted: bytes) -> bytes:
    heard, deadline = b"", time.monotonic() + DEADLINE_S
    while wanted not in heard and time.monotonic() < deadline:
        heard += connection.read()
        time.sleep(0.005)
    return heard


def port_of(connection: OperatorConnection) -> int:
    return int(connection.name.rpartition(":")[2])


def test_udp_in_answers_whoever_spoke(opened: Callable[[str], OperatorConnection]) -> None:
    ground = opened("udpin:127.0.0.1:0")
    ground.write(b"nobody yet")
    rovers = [opened(f"udpout:127.0.0.1:{port_of(ground)}") for _ in range(2)]
    for number, rover in enumerate(rovers):
        rover.write(b"rover %d" % number)
        assert read_until(ground, b"rover %d" % number) == b"rover %d" % number
    ground.write(b"to all")
    assert [read_until(rover, b"to all") for rover in rovers] == [b"to all", b"to all"]


def test_udp_in_answers_the_newest_of_many_senders(opened: Callable[[str], OperatorConnection]) -> None:
    ground = opened("udpin:127.0.0.1:0")
    senders = [opened(f"udpout:127.0.0.1:{port_of(ground)}") for _ in range(MAX_PEERS + 1)]
    for number, sender in enumerate(senders):
        sender.write(b"sender %02d" % number)
        assert read_until(ground, b"sender %02d" % number)
    ground.write(b"to these")
    assert read_until(senders[-1], b"to these") == b"to these"
    assert senders[0].read() == b""


def test_udp_in_forgets_who_is_silent(
    opened: Callable[[str], OperatorConnection], monkeypatch: pytest.MonkeyPatch
) -> None:
    ground = opened("udpin:127.0.0.1:0")
    rover = opened(f"udpout:127.0.0.1:{port_of(ground)}")
    rover.write(b"here")
    read_until(ground, b"here")
    assert isinstance(ground, UdpConnection)
    later = time.monotonic() + 60.0
    monkeypatch.setattr(time, "monotonic", lambda: later)
    ground.write(b"gone")
    monkeypatch.undo()
    assert rover.read() == b""


def test_udp_out_to_nobody_loses_and_goes_on(opened: Callable[[str], OperatorConnection]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        free = taken.getsockname()[1]
    connection = opened(f"udpout:127.0.0.1:{free}")
    for _ in range(3):
        connection.write(b"hello?")
        assert connection.read() == b""


def test_tcp_comes_up_later_breaks_and_comes_again(
    opened: Callable[[str], OperatorConnection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "REOPEN_S", 0.02)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        connection = opened(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        assert connection.read() == b""
        server.listen()
        server.settimeout(DEADLINE_S)
        for word in (b"first", b"again"):
            wait_for(lambda: connection.read() == b"" and connection.fileno() is not None, DEADLINE_S)
            peer, _ = server.accept()
            with peer:
                peer.settimeout(DEADLINE_S)
                peer.sendall(word)
                assert read_until(connection, word) == word
                connection.write(b"echo " + word)
                assert peer.recv(100) == b"echo " + word
            wait_for(lambda: connection.read() == b"" and connection.fileno() is None, DEADLINE_S)


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="not on this platform")
def test_a_tcp_peer_that_is_gone_without_a_word_is_noticed_within_15_seconds(
    opened: Callable[[str], OperatorConnection],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        connection = opened(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        connection.read()
        with socket.socket(fileno=os.dup(connection.fileno() or 0)) as asked:
            idle, pause, tries, unconfirmed = (
                asked.getsockopt(socket.IPPROTO_TCP, getattr(socket, name))
                for name in ("TCP_KEEPIDLE", "TCP_KEEPINTVL", "TCP_KEEPCNT", "TCP_USER_TIMEOUT")
            )
            assert asked.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    assert idle + pause * tries <= 15
    assert 0 < unconfirmed <= 15_000


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="not on this platform")
def test_a_tcp_peer_that_confirms_nothing_any_more_is_connected_to_again(
    opened: Callable[[str], OperatorConnection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(devices.OPTIONS, "TCP_USER_TIMEOUT", 200)
    with socket.create_server(("127.0.0.1", 0)) as server:
        connection = opened(f"tcp:127.0.0.1:{server.getsockname()[1]}")

        def gone() -> bool:
            for _ in range(1000):
                connection.write(bytes(4096))
            return connection.read() == b"" and "timed out" in connection.trouble

        wait_for(gone, DEADLINE_S)
        wait_for(lambda: connection.read() == b"" and connection.fileno() is not None, DEADLINE_S)


def test_tcp_keeps_no_more_than_a_little_for_a_peer_that_does_not_read() -> None:
    class Deaf:
        def send(self, _waiting: bytes) -> int:
            raise BlockingIOError

        def receive(self) -> bytes:
            raise BlockingIOError

        def close(self) -> None:
            pass

    stream = streams.ReopeningConnection("deaf", Deaf)
    stream.read()
    for _ in range(10_000):
        stream.write(b"x" * 100)
    assert len(stream._unsent) <= streams.MAX_UNSENT


def test_a_serial_device_that_is_plugged_in_later_is_found(
    opened: Callable[[str], OperatorConnection],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    pytest.importorskip("serial")
    monkeypatch.setattr(streams, "REOPEN_S", 0.02)
    device = tmp_path / "radio"
    connection = opened(f"serial:{device}:57600")
    connection.write(b"lost")
    assert connection.read() == b""
    ours, theirs = pty.openpty()
    try:
        tty.setraw(theirs)
        device.symlink_to(os.ttyname(theirs))
        wait_for(lambda: connection.read() == b"" and connection.fileno() is not None, DEADLINE_S)
        os.write(ours, b"from the rover")
        assert read_until(connection, b"rover") == b"from the rover"
        connection.write(b"from the ground")
        assert os.read(ours, 100) == b"from the ground"
    finally:
        os.close(theirs)
        os.close(ours)
    wait_for(lambda: connection.read() == b"" and connection.fileno() is None, DEADLINE_S)


def test_a_serial_device_that_takes_nothing_blocks_nothing(
    opened: Callable[[str], OperatorConnection],
) -> None:
    pytest.importorskip("serial")
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    connection = opened(f"serial:{os.ttyname(theirs)}:57600")
    connection.read()

    def fill() -> None:
        for _ in range(1000):
            connection.write(bytes(200))

    filling = threading.Thread(target=fill, daemon=True)
    filling.start()
    filling.join(DEADLINE_S)
    assert not filling.is_alive(), "it waits for the device"
    assert connection.fileno() is not None
    os.close(theirs)
    os.close(ours)


@pytest.mark.parametrize(
    "link",
    ["", "udpin", "udpin:14550", "udpin:127.0.0.1:", "udpin:127.0.0.1:-1", "tcp:127.0.0.1:70000",
     "file:/etc/passwd", "udpout::1", "serial:", "udpin:127.0.0.1:१४"],
)  # fmt: skip
def test_what_is_no_link_is_refused_with_an_example(link: str) -> None:
    with pytest.raises(LinkError, match="write it as"):
        open_connection(link)


def test_a_serial_speed_that_is_no_number_is_refused() -> None:
    with pytest.raises(LinkError, match="serial:/dev/ttyUSB0:57600"):
        open_connection("serial:/dev/ttyUSB0:fast")


def test_a_port_that_is_taken_is_said(opened: Callable[[str], OperatorConnection]) -> None:
    ground = opened("udpin:127.0.0.1:0")
    with pytest.raises(LinkError, match="Is the port taken"):
        open_connection(ground.name)


def test_a_name_server_that_does_not_answer_blocks_nothing_but_the_link(
    opened: Callable[[str], OperatorConnection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "REOPEN_S", 0.02)
    monkeypatch.setattr(lookup, "PATIENCE_S", 0.05)
    monkeypatch.setattr(lookup, "SILENT_S", 0.05)
    answers, asked = threading.Event(), []

    def looked_up(host: str, port: int, flags: int = 0) -> Any:
        if flags:
            raise socket.gaierror("a name")
        asked.append(host)
        assert answers.wait(DEADLINE_S)
        return [(socket.AF_INET, None, None, "", ("127.0.0.1", port))]

    with socket.create_server(("127.0.0.1", 0)) as server:
        link = f"tcp:ground.example:{server.getsockname()[1]}"
        monkeypatch.setattr(socket, "getaddrinfo", looked_up)
        with pytest.raises(LinkError, match="no name server says who ground"):
            open_connection(link)
        answers.set()
        connection = opened(link)
        wait_for(lambda: connection.read() == b"" and connection.fileno() is not None, DEADLINE_S)
        answers.clear()
        server.accept()[0].close()
        before = len(asked)
        wait_for(lambda: connection.read() == b"" and "no name server" in connection.trouble, DEADLINE_S)
        for _ in range(50):
            connection.read()
        assert len(asked) == before + 1, "one lookup at a time"
        answers.set()
        wait_for(lambda: connection.read() == b"" and connection.fileno() is not None, DEADLINE_S)


def test_a_host_that_cannot_be_is_said() -> None:
    with pytest.raises(LinkError, match="Is the name right"):
        open_connection(f"tcp:{'a' * 300}:5760")
