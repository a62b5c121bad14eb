"""Real sockets, with pymavlink at the other end."""

import contextlib
import os
import socket
import time
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettings
from companion.link.inbound import InboundEvent
from companion.link.parser import Parser
from companion.link.streams import Tcp
from companion.link.transport import KEPT, Udp, open_transport
from companion.wire import devices
from companion.wire.answers import Answer, Via
from companion.wire.ids import Motion
from tests.companion.link.devices import AUTOPILOT, DEADLINE, GROUND, HEARTBEAT, Peer, link_to, until

GO = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 7, 1, 0, 0, 0, 0, 0)


def test_udpout_speaks_first_and_hears_answers(ground: socket.socket) -> None:
    port = ground.getsockname()[1]
    link = link_to(f"udpout:127.0.0.1:{port}")
    source: list[Any] = []

    def receive() -> bytes:
        data, address = ground.recvfrom(2048)
        source[:] = [address]
        return data

    peer = Peer(receive, lambda data: ground.sendto(data, source[0]))
    until(link, lambda: "HEARTBEAT" in peer.types(), peer)
    peer.send(HEARTBEAT.pack(AUTOPILOT))
    until(link, lambda: link.vehicle is not None, peer)
    peer.send(GO.pack(GROUND))
    heard: list[InboundEvent] = []
    end = time.monotonic() + DEADLINE
    while not heard and time.monotonic() < end:
        heard = [event for event in link.poll(time.monotonic()) if isinstance(event, Answer)]
    assert heard == [Answer(7, Motion.GO, sender=(255, 190), via=Via.COMMAND)]
    link.close()


def test_udpout_hears_only_the_address_that_it_speaks_to(ground: socket.socket) -> None:
    transport = open_transport(LinkSettings(f"udpout:127.0.0.1:{ground.getsockname()[1]}").address())
    transport.write(b"hello")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        assert isinstance(transport, Udp)
        stranger.sendto(b"stranger", ("127.0.0.1", transport.port))
        ground.sendto(b"friend", ("127.0.0.1", transport.port))
        got = b""
        end = time.monotonic() + DEADLINE
        while b"friend" not in got and time.monotonic() < end:
            got += transport.read()
    assert got == b"friend"
    transport.close()


def test_udpin_waits_for_the_autopilot_and_answers_where_it_came_from(ground: socket.socket) -> None:
    transport = Udp(LinkSettings("udpin:127.0.0.1:0").address())
    link = link_to("udpin:127.0.0.1:0", opener=lambda: transport)
    peer = Peer(lambda: ground.recv(2048), lambda data: ground.sendto(data, ("127.0.0.1", transport.port)))
    peer.send(HEARTBEAT.pack(AUTOPILOT))
    until(link, lambda: "HEARTBEAT" in peer.types(), peer)
    assert peer.got[0].get_srcSystem() == 1
    link.close()


def test_udpin_answers_four_whose_frames_were_believed_and_a_fifth_when_one_is_silent() -> None:
    transport = Udp(LinkSettings("udpin:127.0.0.1:0").address())
    assert not transport.write(b"nobody yet")
    peers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(6)]

    def heard(number: int, now: float) -> None:
        peers[number].sendto(b"x", ("127.0.0.1", transport.port))
        end = time.monotonic() + DEADLINE
        while not transport.read():
            assert time.monotonic() < end, "too late"
        if number:
            transport.note_accepted(now, autopilot=False)

    def told() -> list[int]:
        assert transport.write(b"frame")
        got = []
        for number, peer in enumerate(peers):
            peer.settimeout(0)
            with contextlib.suppress(BlockingIOError):
                got += [number] * (peer.recv(10) == b"frame")
        return got

    try:
        for number in range(6):
            heard(number, float(number))
        assert told() == [1, 2, 3, 4]
        heard(5, 1.0 + KEPT)
        assert told() == [1, 2, 3, 4]
        heard(5, 1.1 + KEPT)
        assert told() == [2, 3, 4, 5]
    finally:
        transport.close()
        for peer in peers:
            peer.close()


@pytest.mark.parametrize("scheme", ["udpin", "udpout"])
def test_what_waits_behind_datagrams_that_say_nothing_is_heard_at_once(
    ground: socket.socket, scheme: str
) -> None:
    fixed = scheme == "udpout"
    port = ground.getsockname()[1] if fixed else 0
    transport = Udp(ConnectionSettings(f"{scheme}:127.0.0.1:{port}").address())
    link = link_to("udpin:127.0.0.1:0", opener=lambda: transport)
    transport.write(b"so that it has a port")
    there = ("127.0.0.1", transport.port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(20):
            stranger.sendto(b"stranger" if fixed else b"", there)
        ground.sendto(HEARTBEAT.pack(AUTOPILOT), there)
        link.poll(time.monotonic())
        assert link.vehicle is not None
    link.close()


def test_a_udp_port_where_nobody_listens_is_harmless() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    link = link_to(f"udpout:127.0.0.1:{port}")
    for step in range(20):
        link.poll(time.monotonic() + step)
        link.tick(time.monotonic() + step)
    assert link.trouble is None
    link.close()


def test_an_address_that_may_not_be_sent_to_is_trouble() -> None:
    link = link_to("udpout:255.255.255.255:14550")
    for step in range(3):
        link.poll(time.monotonic() + step)
        link.tick(time.monotonic() + step)
    assert str(link.trouble) == "link lost: Permission denied"
    link.close()


def test_a_port_that_is_taken_is_tried_again_and_named(ground: socket.socket) -> None:
    link = link_to(f"udpin:127.0.0.1:{ground.getsockname()[1]}")
    link.poll(time.monotonic())
    assert "in use" in str(link.trouble)
    assert link.filenos() == []
    ground.close()
    link.poll(time.monotonic() + 1.0)
    assert link.filenos() != []
    link.close()


@pytest.mark.slow
def test_tcp_connects_survives_a_restart_of_the_other_end_and_connects_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE)
        port = server.getsockname()[1]
        link = link_to(f"tcp:127.0.0.1:{port}")
        link.poll(time.monotonic())
        for _ in range(2):
            connected, _address = server.accept()
            connected.settimeout(0)
            peer = Peer(lambda: connected.recv(2048), connected.sendall)  # noqa: B023
            until(link, lambda: "HEARTBEAT" in peer.types(), peer)  # noqa: B023
            connected.close()
            until(link, lambda: link.filenos() == [])
            assert "link lost" in str(link.trouble)
            until(link, lambda: link.filenos() != [])
        link.close()


def test_a_tcp_port_that_was_closed_for_long_is_found_within_half_a_second_of_its_return() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    link, now = link_to(f"tcp:127.0.0.1:{port}"), time.monotonic()
    for _ in range(200):
        now += 0.05
        link.poll(now)
    with socket.create_server(("127.0.0.1", port)) as server:
        server.settimeout(0)
        for _ in range(11):
            now += 0.05
            link.poll(now)
        server.accept()[0].close()
    link.close()


def test_tcp_refused_is_tried_again_quietly() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    link = link_to(f"tcp:127.0.0.1:{port}")
    now = time.monotonic()
    for step in range(50):
        link.poll(now + step * 0.1)
        link.tick(now + step * 0.1)
    assert "refused" in str(link.trouble)
    link.close()


@pytest.mark.slow
def test_a_tcp_peer_that_does_not_read_blocks_nothing_and_gets_whole_frames() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE)
        transport = Tcp(LinkSettings(f"tcp:127.0.0.1:{server.getsockname()[1]}").address())
        connected, _address = server.accept()
        frame = mavlink.MAVLink_statustext_message(6, b"x" * 50).pack(GROUND)
        end = time.monotonic() + DEADLINE
        sent = 0
        while time.monotonic() < end:
            if not transport.write(frame):
                if sent > 1000:
                    break
                continue
            sent += 1
        assert sent > 1000
        connected.settimeout(0.2)
        parser, found = Parser(), 0
        while found < sent and time.monotonic() < end:
            found += len(parser.feed(connected.recv(65536), 0.0, whole=False))
            transport.write(frame)
        assert parser.bad == 0
        connected.close()
        transport.close()


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="not on this platform")
def test_a_tcp_peer_that_confirms_nothing_any_more_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(devices.OPTIONS, "TCP_USER_TIMEOUT", 200)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE)
        transport = Tcp(LinkSettings(f"tcp:127.0.0.1:{server.getsockname()[1]}").address())
        connected, _address = server.accept()

        def talk() -> None:
            end = time.monotonic() + DEADLINE
            while time.monotonic() < end:
                if not transport.write(bytes(250)):
                    time.sleep(0.01)
                transport.read()

        with pytest.raises(OSError, match="timed out"):
            talk()
        connected.close()
        transport.close()


@pytest.mark.skipif(not hasattr(socket, "TCP_KEEPIDLE"), reason="not on this platform")
def test_a_silent_tcp_connection_is_tried_within_15_seconds() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        transport = Tcp(LinkSettings(f"tcp:127.0.0.1:{server.getsockname()[1]}").address())
        asked = socket.socket(fileno=os.dup(transport.fileno() or 0))
        idle, pause, tries = (
            asked.getsockopt(socket.IPPROTO_TCP, getattr(socket, name))
            for name in ("TCP_KEEPIDLE", "TCP_KEEPINTVL", "TCP_KEEPCNT")
        )
        assert asked.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        assert idle + pause * tries <= 15
        asked.close()
        transport.close()
