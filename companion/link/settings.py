"""What a person says about the link, checked."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import NamedTuple

_FORMS = "udpin:0.0.0.0:14550, udpout:127.0.0.1:14550, tcp:127.0.0.1:5760 or serial:/dev/ttyAMA0:57600"
_SMALLEST_BURST = 300.0
_SMALLEST_BUDGET = 50.0


class LinkError(ValueError):
    """A setting of the link that cannot work; the message says what can."""


class Address(NamedTuple):
    """scheme: udpin, udpout, tcp or serial. place: numeric host or device. number: port or baud rate."""

    scheme: str
    place: str
    number: int


@dataclass(frozen=True)
class LinkSettings:
    """url: udpin:host:port, udpout:host:port, tcp:host:port or serial:device:baud.

    system_id: used until the autopilot's own is known. budget: B/s of unsolicited traffic, 0 unlimited;
    asked_budget: B/s of what somebody asked for; burst: bytes for each of the two. pace: least s between
    frames (0.05 behind PX4). allowed_senders: first and last system id that may change anything.
    Raises LinkError.
    """

    url: str
    system_id: int = 1
    budget: float = 300.0
    burst: float = 600.0
    asked_budget: float = 1500.0
    pace: float = 0.030
    allowed_senders: tuple[int, int] = (245, 255)

    def __post_init__(self) -> None:
        self.address()
        if not 1 <= self.system_id <= 254:
            raise LinkError(f"system_id {self.system_id} is not in 1..254 (255 is the ground's)")
        for name, rate in (("budget", self.budget), ("asked_budget", self.asked_budget)):
            if rate != 0 and not rate >= _SMALLEST_BUDGET:
                raise LinkError(
                    f"{name} {rate:g} B/s is too little: 0 (unlimited) or {_SMALLEST_BUDGET:g} up"
                )
        if not self.burst >= _SMALLEST_BURST:
            raise LinkError(f"burst {self.burst:g} holds no frame: {_SMALLEST_BURST:g} bytes up")
        if not 0.0 <= self.pace <= 1.0:
            raise LinkError(f"pace {self.pace:g} s is not in 0..1")
        first, last = self.allowed_senders
        if not 1 <= first <= last <= 255:
            raise LinkError(f"allowed_senders {first}..{last}: two system ids, the smaller one first")

    def address(self) -> Address:
        """The url, taken apart. Hosts are numeric, since looking up a name can block for seconds."""
        scheme, _, rest = self.url.partition(":")
        place, _, number = rest.rpartition(":")
        if scheme not in {"udpin", "udpout", "tcp", "serial"} or not place or not number.isdecimal():
            raise LinkError(f'link "{self.url}" is not understood: {_FORMS}')
        if scheme == "serial":
            return Address(scheme, place, int(number))
        try:
            host = str(ipaddress.IPv4Address("127.0.0.1" if place == "localhost" else place))
        except ValueError as error:
            raise LinkError(f'link "{self.url}": "{place}" is no IPv4 address (no names)') from error
        if int(number) > 65535 or (int(number) == 0 and scheme != "udpin"):
            raise LinkError(f'link "{self.url}": port {number} is not in 1..65535')
        return Address(scheme, host, int(number))

    @property
    def waits_for_vehicle(self) -> bool:
        """Whether to stay silent until the autopilot is heard. A router may wait for us instead."""
        return self.address().scheme in {"udpin", "serial"}
