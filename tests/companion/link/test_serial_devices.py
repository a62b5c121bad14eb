"""A pseudo-terminal in place of a serial port, with pymavlink at the other end."""

import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import Address, ConnectionSettings, LinkSettingError, LinkSettings
from companion.link.link import Link
from companion.link.parser import Parser
from companion.link.transport import Udp, open_transport
from companion.wire.parameters import build
from tests.companion.link.devices import AUTOPILOT, DEADLINE, GROUND, HEARTBEAT, Peer, link_to, until


def test_a_serial_port_waits_for_the_autopilot_and_is_missed_when_it_is_pulled() -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    link = link_to(f"serial:{os.ttyname(slave)}:57600")
    peer = Peer(lambda: os.read(master, 2048), lambda data: os.write(master, data))
    link.poll(time.monotonic())
    link.tick(time.monotonic())
    peer.read()
    assert peer.got == []
    peer.send(HEARTBEAT.pack(AUTOPILOT))
    until(link, lambda: "HEARTBEAT" in peer.types(), peer)
    os.close(slave)
    os.close(master)
    until(link, lambda: link.trouble is not None)
    assert link.filenos() == []
    link.close()


def test_a_serial_port_that_takes_nothing_blocks_nothing_and_gets_whole_frames() -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(slave)
    transport = open_transport(LinkSettings(f"serial:{os.ttyname(slave)}:57600").address())
    frame = mavlink.MAVLink_statustext_message(6, b"x" * 50).pack(GROUND)
    sent: list[bool] = []

    def fill() -> None:
        while not sent or sent[-1]:
            sent.append(transport.write(frame))

    filling = threading.Thread(target=fill, daemon=True)
    filling.start()
    filling.join(DEADLINE)
    assert not filling.is_alive(), "it waits for the port"
    parser, found = Parser(), 0
    end = time.monotonic() + DEADLINE
    while found < len(sent) - 1 and time.monotonic() < end:
        found += len(parser.feed(os.read(master, 65536), 0.0, whole=False))
        transport.write(frame)
    assert found >= len(sent) - 1
    assert parser.bad == 0
    transport.close()
    os.close(slave)
    os.close(master)


def test_a_serial_port_that_does_not_take_its_speed_is_trouble_and_no_crash() -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    address = Address("serial", os.ttyname(slave), 99999999999)
    link = link_to("serial:/dev/ttyAMA0:57600", opener=lambda: open_transport(address))
    link.poll(time.monotonic())
    assert str(link.trouble).startswith("link lost: ")
    link.close()
    os.close(slave)
    os.close(master)


def test_a_serial_port_that_was_unplugged_for_long_is_open_half_a_second_after_it_is_back(
    tmp_path: Path,
) -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(slave)
    by_id = tmp_path / "usb-autopilot"
    link, now = link_to(f"serial:{by_id}:57600"), time.monotonic()
    for _ in range(200):
        now += 0.05
        link.poll(now)
    assert link.filenos() == []
    by_id.symlink_to(os.ttyname(slave))
    for _ in range(11):
        now += 0.05
        link.poll(now)
    assert link.filenos() != []
    link.close()
    os.close(slave)
    os.close(master)


def test_a_serial_device_that_is_absent_is_named() -> None:
    pytest.importorskip("serial")
    link = link_to("serial:/dev/does-not-exist:57600")
    link.poll(time.monotonic())
    assert "/dev/does-not-exist is not there" in str(link.trouble)
    link.tick(time.monotonic())


def test_without_pyserial_a_serial_link_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "serial", None)
    with pytest.raises(LinkSettingError, match="pip install"):
        link_to("serial:/dev/ttyAMA0:57600")


def test_an_autopilot_on_a_serial_port_and_ground_stations_by_network_at_once(ground: socket.socket) -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    network = Udp(LinkSettings("udpin:127.0.0.1:0").address())
    url = f"serial:{os.ttyname(slave)}:57600"
    more = {"wifi": ConnectionSettings("udpin:127.0.0.1:0", budget=0.0)}
    openers: dict[str, Callable[[], Any]] = {"wifi": lambda: network}
    link = Link(LinkSettings(url, more=more), build(["grass"], {}, {}), time.monotonic(), openers=openers)
    autopilot = Peer(lambda: os.read(master, 2048), lambda data: os.write(master, data))
    second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    second.settimeout(0)
    there = ("127.0.0.1", network.port)
    first = Peer(lambda: ground.recv(2048), lambda data: ground.sendto(data, there))
    late = Peer(lambda: second.recv(2048), lambda data: second.sendto(data, there))
    link.poll(time.monotonic())
    for peer in (first, late):
        peer.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(GROUND))
    autopilot.send(HEARTBEAT.pack(AUTOPILOT))
    everybody = (autopilot, first, late)
    until(link, lambda: all("HEARTBEAT" in peer.types() for peer in everybody), *everybody)
    assert len(link.filenos()) == 2
    late.send(mavlink.MAVLink_param_request_list_message(1, 191).pack(GROUND))
    link.modes.command(4, time.monotonic())
    until(link, lambda: "COMMAND_LONG" in autopilot.types() and "PARAM_VALUE" in late.types(), *everybody)
    os.close(slave)
    os.close(master)
    until(link, lambda: link.trouble is not None)
    assert str(link.trouble).startswith("link lost: ")
    before = late.types().count("HEARTBEAT")
    until(link, lambda: late.types().count("HEARTBEAT") > before, first, late)
    assert "PARAM_VALUE" not in autopilot.types()
    assert "COMMAND_LONG" not in late.types()
    link.close()
    second.close()
