"""A device that takes nothing, or little: what may leave late does not, and a hold leaves first."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import time
import tty
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, ConnectionSettings, LinkSettings
from companion.link.connection import Connection
from companion.link.link import Link
from companion.link.sender import Sender
from companion.link.streams import STUCK_AFTER, StuckError, Tcp
from companion.link.transport import Transport
from companion.sim.loopback_link import MemoryTransport
from companion.wire.ids import MODE_REQUEST_COMMAND
from companion.wire.parameters import build
from tests.companion.link.devices import AUTOPILOT, DEADLINE, HEARTBEAT, Peer

AUTO, HOLD = 10, 4
_STEP = 0.02


NO_SCRIPT = mavlink.MAVLink_command_ack_message(MODE_REQUEST_COMMAND, 3, 0, 0, 1, 191)
"""The autopilot's answer to the question whether our script runs on it: UNSUPPORTED."""

_FAR_BUFFER = 4200
"""Bytes, a little more than a pseudo-terminal passes on to an end that does not read."""


class Port:
    """A pseudo-terminal whose other end reads only when it is told, with a link in virtual time."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        os.set_blocking(self.slave, False)
        self.now = 100.0
        self.url = f"serial:{os.ttyname(self.slave)}:57600"
        self.link = Link(LinkSettings(self.url), build(["grass"], {}, {}), self.now)
        self.peer = Peer(lambda: os.read(self.master, 65536), lambda data: os.write(self.master, data))

    def meet(self) -> None:
        """Let the link hear the autopilot, and speak first."""
        end = time.monotonic() + DEADLINE
        while "HEARTBEAT" not in self.peer.types():
            assert time.monotonic() < end, "too late"
            self.run(0.5)
            self.read()
            time.sleep(0.01)
        self.peer.send(NO_SCRIPT.pack(AUTOPILOT))
        self.run(0.5)
        self.read()
        self.peer.got.clear()

    def run(self, seconds: float) -> None:
        """Let virtual time pass; the autopilot sends a heartbeat every second."""
        for _ in range(round(seconds / _STEP)):
            if round(self.now / _STEP) % round(1.0 / _STEP) == 0:
                self.peer.send(HEARTBEAT.pack(AUTOPILOT))
            self.link.poll(self.now)
            self.link.tick(self.now)
            self.now = round(self.now + _STEP, 3)

    def fill(self, size: int = 1 << 20) -> None:
        """Put bytes into the device until it is full, the other end's own buffer as well."""
        end, quiet = time.monotonic() + DEADLINE, 0
        while size > 0 and quiet < 5:
            assert time.monotonic() < end, "too late"
            try:
                size -= os.write(self.slave, bytes(min(64, size)))
                quiet = 0
            except BlockingIOError:
                quiet += 1
                time.sleep(0.01)
        time.sleep(0.02)

    def read(self) -> None:
        """Let the other end read all that there is."""
        for _ in range(10):
            self.peer.read()

    def modes(self) -> list[float]:
        """The modes that were commanded at the other end, in order."""
        return [one.param2 for one in self.peer.got if _is_mode(one)]

    def close(self) -> None:
        self.link.close()
        os.close(self.slave)
        os.close(self.master)


@pytest.fixture
def port() -> Iterator[Port]:
    pytest.importorskip("serial")
    port = Port()
    port.meet()
    yield port
    port.close()


def _is_mode(message: Any) -> bool:
    return bool(message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE)


def test_a_resume_that_was_cancelled_while_the_device_was_full_never_leaves(port: Port) -> None:
    port.run(0.1)
    port.read()
    port.fill()
    port.link.modes.command(AUTO, port.now)
    port.run(0.4)
    port.link.modes.cancel()
    port.read()
    port.run(5.0)
    port.read()
    assert port.modes() == []
    assert "HEARTBEAT" in port.peer.types()


def test_a_resume_that_the_kernel_has_taken_is_taken_back_and_the_hold_goes_first(port: Port) -> None:
    port.fill(_FAR_BUFFER)
    port.link.modes.command(AUTO, port.now)
    port.run(0.1)
    port.link.modes.command(HOLD, port.now)
    port.run(0.1)
    port.read()
    assert port.modes() == [HOLD]
    port.peer.got.clear()
    port.run(1.2)
    port.read()
    assert "HEARTBEAT" in port.peer.types()


def test_a_resume_that_nobody_cancelled_does_not_leave_a_second_late_either(port: Port) -> None:
    port.fill(_FAR_BUFFER)
    port.link.modes.command(AUTO, port.now)
    port.run(1.2)
    port.read()
    assert port.modes() == []


def test_a_resume_leaves_at_once_where_nothing_waits_and_once_only(port: Port) -> None:
    port.run(1.0)
    port.link.modes.command(AUTO, port.now)
    port.run(0.06)
    port.read()
    assert port.modes() == [AUTO]
    port.link.modes.cancel()
    port.run(1.2)
    port.read()
    assert port.modes() == [AUTO]
    assert port.peer.types()[-1] != "BAD_DATA"


def test_a_device_that_takes_nothing_for_a_second_is_opened_again_and_a_hold_leaves_then(port: Port) -> None:
    port.run(0.1)
    port.read()
    port.fill()
    port.link.modes.command(HOLD, port.now)
    port.run(STUCK_AFTER - 0.2)
    assert str(port.link.trouble) == "None"
    port.run(0.3)
    assert str(port.link.trouble) == "link lost: takes nothing: check its cable and flow control"
    port.link.modes.command(HOLD, port.now)
    port.run(0.7)
    assert str(port.link.trouble) != "None", "hearing it does not say that it takes anything"
    port.read()
    assert port.modes() == [HOLD]
    port.run(3.0)
    assert str(port.link.trouble) == "None"


def test_what_a_device_took_of_a_frame_swallows_no_hold_behind_it(port: Port) -> None:
    port.run(0.1)
    port.read()
    os.write(port.slave, mavlink.MAVLink_statustext_message(6, b"x" * 50).pack(AUTOPILOT)[:20])
    port.fill()
    port.link.texts.send("a text", 6, port.now)
    port.run(1.6)
    port.link.modes.command(HOLD, port.now)
    port.run(0.5)
    port.read()
    assert port.modes() == [HOLD]


class Line(MemoryTransport):
    """A device that says what waits in it."""

    rate = 5760.0

    def __init__(self) -> None:
        super().__init__()
        self.waits = 0
        self.recalled = 0
        self.written: list[bytes] = []

    def write(self, frame: bytes) -> bool:
        self.written.append(frame)
        return True

    def idle(self) -> bool:
        return self.waits == 0

    def settled(self) -> bool:
        return False

    def has_room(self) -> bool:
        return self.waits <= 576

    def recall(self) -> None:
        self.recalled += 1


@pytest.fixture
def line() -> Line:
    return Line()


@pytest.fixture
def sender(line: Line) -> Sender:
    connection = Connection(lambda: line, 0.0)
    connection.read(0.0)
    return Sender(connection, ConnectionSettings("serial:/dev/null:57600"), 0.0)


def _mode(mode: int) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, mode, 0, 0, 0, 0, 0)


_BEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
_TEXT = mavlink.MAVLink_statustext_message(6, b"a text")
_SETPOINT = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 3527, *[0.0] * 11)


def _sent(line: Line) -> list[str]:
    found = mavlink.MAVLink(None).parse_buffer(b"".join(line.written)) or []
    line.written.clear()
    return [message.get_type() for message in found]


def test_a_resume_waits_until_nothing_waits_and_only_what_is_urgent_passes_it(
    line: Line, sender: Sender
) -> None:
    line.waits = 1
    sender.push("resume", _mode(AUTO), 1.0, lifetime=1.0)
    sender.push("text", _TEXT, 1.0)
    sender.push("setpoint", _SETPOINT, 1.0)
    sender.push("heartbeat", _BEAT, 1.0)
    for step in range(20):
        sender.tick(1.0 + 0.03 * step)
    assert _sent(line) == ["SET_POSITION_TARGET_LOCAL_NED", "HEARTBEAT"]
    line.waits = 0
    sender.tick(1.7)
    sender.tick(1.8)
    assert _sent(line) == ["COMMAND_LONG", "STATUSTEXT"]


def test_a_resume_that_waited_for_its_second_is_dropped_and_the_rest_goes_on(
    line: Line, sender: Sender
) -> None:
    line.waits = 1
    sender.push("resume", _mode(AUTO), 1.0, lifetime=1.0)
    sender.push("text", _TEXT, 1.0)
    sender.tick(1.9)
    assert _sent(line) == []
    sender.tick(2.1)
    assert _sent(line) == ["STATUSTEXT"]
    assert sender.lost == 1


def test_what_can_wait_is_not_written_before_a_tenth_of_a_second_of_the_line_is_free(
    line: Line, sender: Sender
) -> None:
    line.waits = 577
    sender.push("text", _TEXT, 1.0)
    sender.push("hold", _mode(HOLD), 1.0)
    sender.tick(1.0)
    sender.tick(1.1)
    assert _sent(line) == ["COMMAND_LONG"]
    line.waits = 576
    sender.tick(1.2)
    assert _sent(line) == ["STATUSTEXT"]


def test_a_line_is_not_filled_for_longer_than_a_tenth_of_a_second_where_its_kernel_does_not_tell(
    line: Line,
) -> None:
    connection = Connection(lambda: line, 0.0)
    connection.read(0.0)
    sender = Sender(connection, ConnectionSettings("serial:/dev/null:57600", pace=0.0, burst=6000.0), 0.0)
    for number in range(60):
        text = mavlink.MAVLink_statustext_message(6, f"{number:050}".encode())
        sender.push("text", text, 1.0)
    sender.tick(1.0)
    assert 576 <= len(b"".join(line.written)) <= 576 + 63
    assert not connection.idle(1.05)
    assert connection.idle(1.2)


def test_a_resume_is_taken_back_once_however_often_it_is_cancelled(line: Line, sender: Sender) -> None:
    sender.forget("resume")
    assert line.recalled == 0
    sender.push("resume", _mode(AUTO), 1.0)
    sender.tick(1.0)
    sender.forget("hold")
    assert line.recalled == 0
    sender.forget("resume")
    sender.forget("resume")
    assert line.recalled == 1


@contextlib.contextmanager
def _unread() -> Iterator[tuple[Tcp, socket.socket]]:
    """A TCP transport and the socket at the other end, which nobody reads."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        server.settimeout(DEADLINE)
        transport = Tcp(LinkSettings(f"tcp:127.0.0.1:{server.getsockname()[1]}").address())
        connected, _address = server.accept()
        connected.settimeout(DEADLINE)
        yield transport, connected
        connected.close()
        transport.close()


def _drain(connected: socket.socket) -> bytes:
    found = b""
    with contextlib.suppress(TimeoutError, ConnectionError):
        while data := connected.recv(1 << 20):
            found += data
    return found


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="not on this platform")
def test_over_tcp_a_cancelled_resume_never_leaves_and_the_connection_is_opened_again() -> None:
    with _unread() as (tcp, connected):
        opened: list[Transport] = []

        def opener() -> Transport:
            if opened:
                raise ConnectionRefusedError(111, "refused")
            opened.append(tcp)
            return tcp

        link = Link(LinkSettings("tcp:127.0.0.1:9"), build(["grass"], {}, {}), 0.0, openers={MAIN: opener})
        connected.sendall(HEARTBEAT.pack(AUTOPILOT))
        now = 0.0
        while not link.modes.takes_resume:
            assert now < DEADLINE, "too late"
            now += _STEP
            link.poll(now)
            link.tick(now)
            connected.sendall(NO_SCRIPT.pack(AUTOPILOT))
        assert tcp.write(bytes(8_000_000)), "a part of it"
        link.modes.command(AUTO, now)
        assert link.modes.resume_waits
        for step in range(6):
            link.poll(now + 0.1 * step)
            link.tick(now + 0.1 * step)
        link.modes.cancel()
        for step in range(6, 18):
            link.poll(now + 0.1 * step)
            link.tick(now + 0.1 * step)
        assert "takes nothing" in str(link.trouble) or "refused" in str(link.trouble)
        got = mavlink.MAVLink(None)
        got.robust_parsing = True
        assert not [one for one in got.parse_buffer(_drain(connected)) or [] if _is_mode(one)]
        link.close()


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="not on this platform")
def test_over_tcp_what_was_not_sent_is_taken_back_with_the_connection() -> None:
    with _unread() as (tcp, connected):
        while not tcp.write(b"\xfd" * 8_000_000):
            pass
        tcp.note_revocable()
        with pytest.raises(StuckError):
            tcp.recall()
        tcp.close()
        assert len(_drain(connected)) < 8_000_000


def test_over_tcp_a_frame_that_has_left_is_not_taken_back() -> None:
    with _unread() as (tcp, connected):
        while not tcp.write(b"frame"):
            pass
        tcp.note_revocable()
        tcp.recall()
        assert tcp.write(b"next")
        assert _read_until(connected, b"next").strip(b"\0") == b"framenext"


@pytest.mark.parametrize("cancelled", [True, False], ids=["cancelled", "after its second"])
def test_nor_is_the_connection_closed_for_what_waits_behind_it(cancelled: bool) -> None:
    with _unread() as (tcp, connected):
        connection = Connection(lambda: tcp, 0.0)
        connection.read(0.0)
        while not connection.write(b"resume", 0.0, revocable=True):
            pass
        assert _read_until(connected, b"resume")
        assert connection.write(b"\xfd" * 8_000_000, 0.1), "a part of it, and the rest waits"
        if cancelled:
            connection.recall()
        else:
            connection.read(STUCK_AFTER + 0.1)
        assert connection.trouble is None


def test_but_it_is_for_a_part_of_the_frame_itself() -> None:
    with _unread() as (tcp, connected):
        connection = Connection(lambda: tcp, 0.0)
        connection.read(0.0)
        while not connection.write(b"\xfd" * 8_000_000, 0.0, revocable=True):
            pass
        connection.recall()
        assert connection.trouble is not None
        assert len(_drain(connected)) < 8_000_000


def _read_until(connected: socket.socket, end: bytes) -> bytes:
    found = b""
    while not found.endswith(end):
        found += connected.recv(65536)
    return found
