"""Whom a bound port answers: whoever was believed, and nobody is displaced by noise."""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, Address, LinkSettings
from companion.link.link import Link
from companion.link.signing import open_signing
from companion.link.transport import KEPT, MAX_PEERS, Peers, Udp
from companion.wire.ids import COMPONENT_ID
from companion.wire.parameters import build
from tests.companion.link.devices import HEARTBEAT
from tests.companion.link.test_signed_link import SECRET, WALL, Peer

GROUND_HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
HOLD = 4


class Port:
    """A link on a real udpin port, in virtual time; `more`: sockets of others, made as they are asked for."""

    def __init__(self, closing: ExitStack, key: Path | None = None) -> None:
        self._closing = closing
        self._udp = Udp(Address("udpin", "127.0.0.1", 0))
        self.now = 0.0
        signing = None if key is None else open_signing(key, key.parent, wall=lambda: WALL + self.now)
        settings = LinkSettings("udpin:127.0.0.1:0")
        self.link = Link(settings, build([], {}, {}), 0.0, openers={MAIN: lambda: self._udp}, signing=signing)
        closing.callback(self.link.close)

    def socket(self) -> socket.socket:
        made = self._closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.bind(("127.0.0.1", 0))
        made.connect(("127.0.0.1", self._udp.port))
        made.settimeout(0)
        return made

    def turn(self, seconds: float = 0.02) -> None:
        self.now += seconds
        self.link.poll(self.now)
        self.link.tick(self.now)


@pytest.fixture
def closing() -> Iterator[ExitStack]:
    with ExitStack() as closing:
        yield closing


def read(by: socket.socket) -> list[Any]:
    frames: list[Any] = []
    with contextlib.suppress(BlockingIOError):
        while True:
            frames += mavlink.MAVLink(None).parse_buffer(by.recv(2048)) or []
    return frames


def key_in(folder: Path) -> Path:
    path = folder / "key"
    path.touch(0o600)
    path.write_bytes(SECRET)
    return path


def test_junk_from_eight_ports_does_not_keep_a_signed_operator_from_being_answered(
    tmp_path: Path, closing: ExitStack
) -> None:
    port = Port(closing, key_in(tmp_path))
    autopilot, operator, *others = (port.socket() for _ in range(10))
    pilot, ground = Peer(1, 1), Peer(255, 190)
    told = 0
    for step in range(22 * 50):
        if step % 50 == 0:
            autopilot.send(pilot.frame(HEARTBEAT))
            operator.send(ground.frame(GROUND_HEARTBEAT))
        for number in range(6):
            others[(step + number) % 8].send(b"x")
        port.turn()
        told += sum(message.get_type() == "HEARTBEAT" for message in read(operator))
    assert told >= 20
    assert not any(read(other) for other in others)


def test_well_formed_frames_of_others_keep_no_hold_from_the_autopilot(closing: ExitStack) -> None:
    port = Port(closing)
    autopilot, *others = (port.socket() for _ in range(9))
    for step in range(10):
        autopilot.send(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
        port.turn()
        for number, other in enumerate(others):
            other.send(b"x")
            other.send(GROUND_HEARTBEAT.pack(mavlink.MAVLink(None, 200 + number, 190)))
            other.send(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
        port.turn(1.0)
        port.link.modes.command(HOLD, port.now)
        port.turn(0.1)
        told = [message for message in read(autopilot) if message.get_type() == "COMMAND_LONG"]
        assert HOLD in [message.param2 for message in told if message.command == 176], step


def test_an_operator_who_was_there_first_goes_on_being_answered_beside_well_formed_noise(
    closing: ExitStack,
) -> None:
    port = Port(closing)
    autopilot, operator, *others = (port.socket() for _ in range(10))
    told = 0
    for _ in range(20):
        autopilot.send(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
        operator.send(GROUND_HEARTBEAT.pack(mavlink.MAVLink(None, 255, 190)))
        for other in others:
            other.send(GROUND_HEARTBEAT.pack(mavlink.MAVLink(None, 250, 190)))
        for _ in range(10):
            port.turn(0.1)
        told += sum(message.get_type() == "HEARTBEAT" for message in read(operator))
    assert told >= 19


def test_an_autopilot_that_comes_back_from_another_port_is_answered_there_at_once(closing: ExitStack) -> None:
    port = Port(closing)
    before, after = port.socket(), port.socket()
    for by in (before, after):
        by.send(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
        for _ in range(10):
            port.turn(0.15)
        assert "HEARTBEAT" in [message.get_type() for message in read(by)]


def test_our_own_frames_that_come_back_make_nobody_a_peer(closing: ExitStack) -> None:
    port = Port(closing)
    autopilot, mirror = port.socket(), port.socket()
    autopilot.send(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
    port.turn(1.0)
    for frame in read(autopilot):
        mirror.send(bytes(frame.get_msgbuf()))
    port.turn(1.0)
    assert port.link.counters.rejected["echo"] >= 1
    assert (1, COMPONENT_ID) not in [(one.get_srcSystem(), one.get_srcComponent()) for one in read(mirror)]


steps = st.lists(
    st.tuples(st.integers(0, 9), st.sampled_from(["junk", "believed", "autopilot"]), st.floats(0.0, 6.0)),
    max_size=60,
)


@given(steps)
def test_whoever_was_believed_lately_stays_and_noise_gets_nowhere(
    heard: list[tuple[int, str, float]],
) -> None:
    peers, now, home = Peers(), 0.0, -1
    believed: dict[int, float] = {}
    sure: dict[int, float] = {}
    at_home = -math.inf
    for port, what, pause in heard:
        now += pause
        before = {number for _, number in peers}
        kept = {one for one in before if now - sure.get(one, -math.inf) <= KEPT}
        if what != "junk":
            peers.note_accepted(("127.0.0.1", port), now, autopilot=what == "autopilot")
            believed[port] = now
        if what == "believed":
            sure[port] = now
        if what == "autopilot" and (port == home or now - at_home > KEPT):
            home, at_home = port, now
        after = {number for _, number in peers}
        assert kept <= after, "nobody who was believed lately is displaced"
        if home >= 0:
            assert home in after, "the autopilot's address stays its own"
        assert after <= set(believed), "noise is not answered"
        assert len(after) <= MAX_PEERS + 1
        if what == "junk":
            assert after == before
        if what == "believed" and len(before) < MAX_PEERS:
            assert port in after, "where there is room, whoever is believed is answered"
