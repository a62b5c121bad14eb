"""A link on real devices, and the other end of it."""

import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, LinkSettings
from companion.link.inbound import InboundEvent
from companion.link.link import Link
from companion.wire.parameters import build

DEADLINE = 5.0
AUTOPILOT = mavlink.MAVLink(None, 1, 1)
GROUND = mavlink.MAVLink(None, 255, 190)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)


class Peer:
    """The other end: raw bytes in and out, parsed by pymavlink."""

    def __init__(self, receive: Callable[[], bytes], send: Callable[[bytes], Any]) -> None:
        self._receive = receive
        self._mav = mavlink.MAVLink(None)
        self._mav.robust_parsing = True
        self.send = send
        self.got: list[Any] = []

    def read(self) -> None:
        try:
            data = self._receive()
        except (BlockingIOError, ConnectionError):
            return
        self.got += self._mav.parse_buffer(data) or []

    def types(self) -> list[str]:
        return [message.get_type() for message in self.got]


def until(link: Link, done: Callable[[], bool], *peers: Peer) -> list[InboundEvent]:
    """Let the link live in real time until `done`; fails after 5 s."""
    heard: list[InboundEvent] = []
    end = time.monotonic() + DEADLINE
    while not done():
        assert time.monotonic() < end, "too late"
        heard += link.poll(time.monotonic())
        link.tick(time.monotonic())
        for peer in peers:
            peer.read()
        time.sleep(0.002)
    return heard


def link_to(url: str, *, opener: Callable[[], Any] | None = None) -> Link:
    openers = None if opener is None else {MAIN: opener}
    return Link(LinkSettings(url), build(["grass"], {}, {}), time.monotonic(), openers=openers)
