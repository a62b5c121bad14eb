"""Listening on a port: who is there, and what is said where nobody is."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.desk.setup.listening import listen, ports
from companion.pages.requests import RequestError


def heartbeat(system: int, component: int, kind: int, autopilot: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, system, component)))


@contextmanager
def sending(*datagrams: bytes) -> Iterator[str]:
    """Somebody who sends these to a free port until it is over. Yields the url to listen on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    over = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not over.wait(0.05):
                for datagram in datagrams:
                    out.sendto(datagram, ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield f"udpin:127.0.0.1:{port}"
    finally:
        over.set()
        thread.join()


@pytest.mark.slow
def test_autopilot_and_ground_station_are_told_apart_the_autopilot_first() -> None:
    rover = heartbeat(7, 1, mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    ground = heartbeat(255, 190, mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID)
    with sending(ground, rover) as url:
        told = listen(url)
    assert told["problem"] == ""
    assert [(one["system"], one["component"], one["autopilot"]) for one in told["heard"]] == [
        (7, 1, "ArduPilot"),
        (255, 190, ""),
    ]
    assert told["heard"][0]["type"] == "ground rover"


def test_two_autopilots_are_said_to_be_two() -> None:
    rovers = [heartbeat(one, 1, mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_PX4) for one in (1, 7)]
    with sending(*rovers) as url:
        assert "2 autopilots" in listen(url, 0.4)["problem"]


def test_without_an_autopilot_it_says_who_is_heard_instead() -> None:
    with sending(heartbeat(255, 190, mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID)) as url:
        told = listen(url, 0.4)
    assert "No autopilot" in told["problem"]
    assert len(told["heard"]) == 1


def test_bytes_that_are_no_mavlink_are_said_to_be_none() -> None:
    with sending(b"$GPGGA,123519,4807.038,N*47\r\n") as url:
        told = listen(url, 0.4)
    assert told["heard"] == []
    assert "no MAVLink" in told["problem"]


def test_messages_without_a_heartbeat_are_said_to_be_that() -> None:
    place = mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with sending(bytes(place.pack(mavlink.MAVLink(None, 1, 1)))) as url:
        told = listen(url, 1.0)
    assert "no heartbeat" in told["problem"]


def test_silence_says_what_to_look_at() -> None:
    told = listen("udpin:127.0.0.1:0", 0.2)
    assert "wired and powered" in told["problem"]
    assert told["bytes"] == 0


def test_nothing_is_sent_but_to_an_address_that_must_hear_us_first() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(1.0)
        listen(f"udpout:127.0.0.1:{other.getsockname()[1]}", 0.2)
        data, _ = other.recvfrom(300)
        message = mavlink.MAVLink(None).decode(bytearray(data))
    assert message.get_type() == "HEARTBEAT"
    assert message.get_srcComponent() == 194


def test_a_port_that_is_taken_is_said_to_be() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        told = listen(f"udpin:127.0.0.1:{other.getsockname()[1]}", 0.2)
    assert "in use" in told["problem"]


@pytest.mark.parametrize("url", ["", "udpin", "http://x", "udpin:rover.local:14550", "serial:rtsp://u:p@h:9"])
def test_what_is_no_url_is_refused(url: str) -> None:
    with pytest.raises(RequestError, match=r"not understood|no IPv4"):
        listen(url)


def test_the_usual_addresses_are_offered_after_the_serial_ports() -> None:
    urls = [port["url"] for port in ports()]
    assert "udpin:127.0.0.1:14550" in urls
    serial = [url.startswith("serial:") for url in urls]
    assert serial == sorted(serial, reverse=True)
