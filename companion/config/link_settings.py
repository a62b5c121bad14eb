"""Holds and checks the settings of the open link: connections, rates, budgets, addresses."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from companion.cameras.shown import is_like_a_url, shown

_FORMS = "udpin:0.0.0.0:14550, udpout:127.0.0.1:14550, tcp:127.0.0.1:5760 or serial:/dev/ttyAMA0:57600"
MAIN = "main"
MAX_CONNECTIONS = 4
_NAME = re.compile(r"[a-z][a-z0-9_-]{0,11}")
_SMALLEST_BURST = 300.0
_SMALLEST_BUDGET = 50.0
BITS_PER_BYTE = 10
_SLOWEST = 2400
LONGEST_PACE = 0.1
"""s, the longest pace: heartbeats and setpoints take six frames a second, and replies need some, too."""
LONGEST_PACE_WITH_STICKS = 0.05
"""s, the longest pace with [call] px4_deadman, whose stream takes ten frames a second more."""


class LinkSettingError(ValueError):
    """A setting of the link is not valid; the message says what is."""


class Address(NamedTuple):
    """A parsed url. scheme: udpin, udpout, tcp or serial. place: host or device. number: port or baud."""

    scheme: str
    place: str
    number: int


def read_url(url: str) -> Address:
    """Parse `url`. Raises LinkSettingError.

    Hosts must be numeric: looking up a name can block for seconds.
    """
    scheme, _, rest = url.partition(":")
    place, _, number = rest.rpartition(":")
    if scheme not in {"udpin", "udpout", "tcp", "serial"} or not place or not number.isdecimal():
        raise LinkSettingError(f'link "{shown(url)}" is not understood: {_FORMS}')
    if scheme == "serial":
        if is_like_a_url(place):
            raise LinkSettingError(
                f'link "{shown(url)}" is not understood: a serial link is a device of this computer'
            )
        return Address(scheme, place, int(number))
    try:
        host = str(ipaddress.IPv4Address("127.0.0.1" if place == "localhost" else place))
    except ValueError as error:
        raise LinkSettingError(
            f'link "{shown(url)}": that is no IPv4 address (names are not looked up)'
        ) from error
    if int(number) > 65535 or (int(number) == 0 and scheme != "udpin"):
        raise LinkSettingError(f'link "{shown(url)}": port {number} is not in 1..65535')
    return Address(scheme, host, int(number))


@dataclass(frozen=True)
class ConnectionSettings:
    """The settings of one connection. Raises LinkSettingError.

    url: udpin:host:port, udpout:host:port, tcp:host:port or serial:device:baud. budget: B/s of unsolicited
    traffic, 0 unlimited. asked_budget: B/s of replies, 0 unlimited. burst: bytes that each of the two may
    send at once. pace: least s between frames (0.05 behind PX4), 0 to 0.1. On a serial line both budgets
    together may take half of its capacity: a hold waits behind the bytes in the port's buffers.
    """

    url: str
    budget: float = 300.0
    burst: float = 600.0
    asked_budget: float = 1500.0
    pace: float = 0.030

    def __post_init__(self) -> None:
        self.address()
        if self.room < 2 * _SMALLEST_BUDGET:
            raise LinkSettingError(f'link "{self.url}" is too slow: {_SLOWEST} baud or more')
        for name, rate in (("budget", self.budget), ("asked_budget", self.asked_budget)):
            if rate != 0 and not rate >= _SMALLEST_BUDGET:
                raise LinkSettingError(
                    f"{name} {rate:g} B/s is too little: give 0 (unlimited) or at least {_SMALLEST_BUDGET:g}"
                )
        if not self.burst >= _SMALLEST_BURST:
            raise LinkSettingError(
                f"burst {self.burst:g} is too small: give at least {_SMALLEST_BURST:g} bytes"
            )
        if not 0.0 <= self.pace <= LONGEST_PACE:
            raise LinkSettingError(f"pace {self.pace:g} s is not in 0..{LONGEST_PACE:g}")
        if (self.budget or math.inf) > self.most_budget:
            baud, own = self.address().number, min(self.budget or math.inf, self.room // 2)
            raise LinkSettingError(
                f"budget and asked_budget may take {self.room:g} B/s together, half of what {baud} baud "
                f"carry: set budget = {own:g}, asked_budget = {self.room - own:g}"
            )

    def address(self) -> Address:
        """Parse the url."""
        return read_url(self.url)

    @property
    def room(self) -> float:
        """B/s for both budgets together: half of a serial line's capacity, infinite otherwise."""
        address = self.address()
        return address.number / BITS_PER_BYTE / 2 if address.scheme == "serial" else math.inf

    @property
    def most_budget(self) -> float:
        """B/s that `budget` may be at most; infinite where it may be unlimited."""
        return math.inf if self.room == math.inf else self.room - (self.asked_budget or math.inf)

    @property
    def waits_for_vehicle(self) -> bool:
        """Whether to stay silent until the autopilot is received. Not where a router may wait for us."""
        return self.address().scheme in {"udpin", "serial"}


@dataclass(frozen=True)
class LinkSettings(ConnectionSettings):
    """The settings of the first connection, `MAIN`, and of the whole link. Raises LinkSettingError.

    `MAIN` is preferred where several connections reach the autopilot. system_id: ours until the autopilot's
    is known. allowed_senders: first and last system id that may change anything. more: the other connections
    by name, at most three.
    """

    system_id: int = 1
    allowed_senders: tuple[int, int] = (245, 255)
    more: Mapping[str, ConnectionSettings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.system_id <= 254:
            raise LinkSettingError(f"system_id {self.system_id} is not in 1..254 (255 is the ground's)")
        first, last = self.allowed_senders
        if not 1 <= first <= last <= 255:
            raise LinkSettingError(f"allowed_senders {first}..{last}: two system ids, the smaller one first")
        if len(self.more) >= MAX_CONNECTIONS:
            raise LinkSettingError(f"more: {len(self.more)} are too many, {MAX_CONNECTIONS - 1} at most")
        taken: dict[tuple[object, ...], str] = {}
        for name, connection in self.connections().items():
            other = taken.setdefault(_device(connection.address()), name)
            if other != name:
                section = "[link]" if other == MAIN else f"[link.more.{other}]"
                raise LinkSettingError(
                    f"more.{name}.url is that of {section} too: give each a url of its own"
                )

    def connections(self) -> dict[str, ConnectionSettings]:
        """All connections by name, `MAIN` first."""
        for name in self.more:
            if name == MAIN or not _NAME.fullmatch(name):
                raise LinkSettingError(
                    f'more.{name}: choose a name like "wifi": 1 to 12 of a-z, 0-9, - and _'
                )
        return {MAIN: self, **self.more}


def _device(address: Address) -> tuple[object, ...]:
    """A key that two connections to the same device share. udpin with port 0 gets a free port each time."""
    if address.scheme == "serial":
        return address.scheme, address.place
    return address if address.number else (address, object())
