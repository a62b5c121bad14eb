"""A link in virtual time, between an autopilot and a ground station that are only encoders."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.files.tree import Tree
from companion.link.heard import Heard
from companion.link.link import Link
from companion.link.memory import pair
from companion.link.parser import Parser
from companion.link.settings import MAIN, LinkSettings
from companion.link.signing import Signing
from companion.link.transport import Transport
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.parameters import Parameter, build

STEP = 0.01


class Frame(NamedTuple):
    """What the link sent, when, and how many bytes it was."""

    at: float
    message: Any
    size: int


class Wire:
    """One connection: `frames` keeps what the link sent. mavlink1: what arrives is of that version."""

    def __init__(self) -> None:
        self.near, self.far = pair()
        self.frames: list[Frame] = []
        self.mavlink1 = False
        self.mode = 10
        self.armed = True
        self._parser = Parser()
        self._encoders: dict[tuple[int, int], Any] = {}

    def heartbeat(self, system: int) -> None:
        """The heartbeat of an ArduPilot rover in `mode`."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        message = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 4, 3
        )
        self.send(message, (system, AUTOPILOT_COMPONENT_ID))

    def send(self, message: Any, sender: tuple[int, int] = (255, 190)) -> None:
        """`message` arrives at the link, from a ground station unless `sender` says otherwise."""
        encoder = self._encoders.setdefault(sender, mavlink.MAVLink(None, *sender))
        self.far.write(message.pack(encoder, force_mavlink1=self.mavlink1))
        encoder.seq = (encoder.seq + 1) % 256

    def sent(self, kind: str) -> list[Any]:
        """The messages of this MAVLink type that the link sent, in order."""
        return [frame.message for frame in self.frames if frame.message.get_type() == kind]

    def times(self, kind: str) -> list[float]:
        """When they were sent, to 10 ms."""
        return [round(frame.at, 2) for frame in self.frames if frame.message.get_type() == kind]

    def tunnels(self, payload_type: int) -> list[bytes]:
        """The payloads of this type that the link sent."""
        found = [message for message in self.sent("TUNNEL") if message.payload_type == payload_type]
        return [bytes(message.payload[: message.payload_length]) for message in found]

    def collect(self, now: float) -> None:
        """Take in what the link sent."""
        while data := self.far.read():
            for message in self._parser.feed(data, now, whole=True):
                self.frames.append(Frame(now, message, len(message.get_msgbuf())))


class Rehearsal(Wire):
    """`run` lets time pass; `heard` keeps what the link reported. It is the first connection's wire itself.

    vehicle: system id of an autopilot that says HEARTBEAT there every second in `mode`; None for none.
    more: the wires of the settings' other connections, by name. tree: what the link serves.
    """

    def __init__(
        self,
        settings: LinkSettings | None = None,
        parameters: Sequence[Parameter] | None = None,
        *,
        vehicle: int | None = 1,
        tree: Tree | None = None,
        signing: Signing | None = None,
    ) -> None:
        super().__init__()
        self.now = 0.0
        self.settings = settings or LinkSettings("udpout:127.0.0.1:14550")
        self.more = {name: Wire() for name in self.settings.more}
        wires: dict[str, Wire] = {MAIN: self, **self.more}
        listed = build(["grass", "dry bush"], {"grass": 1.0}, {}) if parameters is None else parameters
        openers = {name: partial(_near, wire) for name, wire in wires.items()}
        self.link = Link(
            self.settings, listed, self.now, openers=openers, tree=tree, signing=signing, clock=lambda: 0.0
        )
        self.vehicle = vehicle
        self.heard: list[Heard] = []
        self._heartbeat_at = 0.0

    def run(self, seconds: float, step: float = STEP) -> None:
        """Poll and tick for so long; the ground's and autopilot's frames are read first."""
        for _ in range(round(seconds / step)):
            if self.vehicle is not None and self.now >= self._heartbeat_at:
                self.heartbeat(self.vehicle)
                self._heartbeat_at = self.now + 1.0
            self.heard += self.link.poll(self.now)
            self.link.tick(self.now)
            for wire in (self, *self.more.values()):
                wire.collect(self.now)
            self.now += step

    def reported(self, kind: type) -> list[Any]:
        """What the link reported of this type."""
        return [event for event in self.heard if isinstance(event, kind)]


def _near(wire: Wire) -> Transport:
    return wire.near
