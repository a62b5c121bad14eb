"""Runs a link in virtual time, without a device: autopilot and ground station are only MAVLink encoders."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, LinkSettings
from companion.config.video import CameraSettings
from companion.link import encode
from companion.link.answer_store import AnswerStore
from companion.link.inbound import InboundEvent
from companion.link.link import Link
from companion.link.parser import Parser
from companion.link.signing import Signing
from companion.link.transport import Datagrams, Transport
from companion.storage.served_tree import Tree
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, COMPONENT_ID, SenderId
from companion.wire.parameters import Parameter, build

_MAX_WAITING = 4096


class MemoryTransport(Datagrams):
    """One end of a pair of transports: what one end writes, the other reads.

    `broken`: read and write raise OSError. `full`: write returns False.
    """

    def __init__(self) -> None:
        self._inbox: deque[bytes] = deque(maxlen=_MAX_WAITING)
        self._outbox: deque[bytes] = self._inbox
        self.broken = False
        self.full = False

    def read(self) -> bytes:
        """Returns the oldest frame that waits, b"" when there is none."""
        self._check()
        return self._inbox.popleft() if self._inbox else b""

    def write(self, frame: bytes) -> bool:
        """Puts a frame into the other end; returns False while `full`."""
        self._check()
        if self.full:
            return False
        self._outbox.append(frame)
        return True

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        """Does nothing: there is only one other end, so that no address has to be trusted."""

    def fileno(self) -> int | None:
        """Returns None: there is no file descriptor."""
        return None

    def close(self) -> None:
        """Does nothing: there is nothing to release."""

    def _check(self) -> None:
        if self.broken:
            raise OSError("unplugged")


def pair() -> tuple[MemoryTransport, MemoryTransport]:
    """Makes two ends that are connected."""
    one, other = MemoryTransport(), MemoryTransport()
    one._outbox, other._outbox = other._inbox, one._inbox
    return one, other


STEP = 0.01


class SentFrame(NamedTuple):
    """A frame that the link sent: when (s), the message, its size in bytes."""

    at: float
    message: Any
    size: int


class Wire:
    """One connection of the link; `frames` stores what the link sent.

    mavlink1: what arrives at the link is MAVLink 1. `mode`, `armed`: what the autopilot's heartbeat says.
    """

    def __init__(self) -> None:
        self.near, self.far = pair()
        self.frames: list[SentFrame] = []
        self.mavlink1 = False
        self.mode = 10
        self.armed = True
        self._parser = Parser()
        self._encoders: dict[tuple[int, int], Any] = {}

    def heartbeat(self, system: int) -> None:
        """Sends the heartbeat of an ArduPilot rover in `mode` to the link."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        message = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, 4, 3
        )
        self.send(message, (system, AUTOPILOT_COMPONENT_ID))

    def send(self, message: Any, sender: tuple[int, int] = (255, 190)) -> None:
        """Sends `message` to the link, from a ground station unless `sender` says otherwise."""
        encoder = self._encoders.setdefault(sender, mavlink.MAVLink(None, *sender))
        self.far.write(message.pack(encoder, force_mavlink1=self.mavlink1))
        encoder.seq = (encoder.seq + 1) % 256

    def sent(self, kind: str) -> list[Any]:
        """Returns the messages of this MAVLink type that the link sent, in order."""
        return [frame.message for frame in self.frames if frame.message.get_type() == kind]

    def times(self, kind: str) -> list[float]:
        """Returns when the messages of this type were sent, in s, rounded to 10 ms."""
        return [round(frame.at, 2) for frame in self.frames if frame.message.get_type() == kind]

    def tunnels(self, payload_type: int) -> list[bytes]:
        """Returns the TUNNEL payloads of this type that the link sent."""
        found = [message for message in self.sent("TUNNEL") if message.payload_type == payload_type]
        return [bytes(message.payload[: message.payload_length]) for message in found]

    def collect(self, now: float) -> None:
        """Parses what the link has sent and stores it in `frames`."""
        while data := self.far.read():
            for message in self._parser.feed(data, now, whole=True):
                self.frames.append(SentFrame(now, message, len(message.get_msgbuf())))


class LoopbackLink(Wire):
    """A link with all its connections in virtual time: `run` lets time pass, `heard` stores its events.

    It is itself the wire of the first connection; `more` are the wires of the others, by name.
    vehicle: system id of an autopilot that sends a HEARTBEAT there every second, in `mode`; None for none.
    tree: the files that the link serves.
    """

    def __init__(
        self,
        settings: LinkSettings | None = None,
        parameters: Sequence[Parameter] | None = None,
        *,
        vehicle: int | None = 1,
        tree: Tree | None = None,
        signing: Signing | None = None,
        answer_store: AnswerStore | None = None,
        camera: CameraSettings | None = None,
    ) -> None:
        super().__init__()
        self.now = 0.0
        self.settings = settings or LinkSettings("udpout:127.0.0.1:14550")
        self.more = {name: Wire() for name in self.settings.more}
        wires: dict[str, Wire] = {MAIN: self, **self.more}
        listed = build(["grass", "dry bush"], {"grass": 1.0}, {}) if parameters is None else parameters
        openers = {name: partial(_near, wire) for name, wire in wires.items()}
        self.link = Link(
            self.settings,
            listed,
            self.now,
            openers=openers,
            tree=tree,
            signing=signing,
            answer_store=answer_store,
            camera=camera,
            clock=lambda: 0.0,
        )
        self.vehicle = vehicle
        self.heard: list[InboundEvent] = []
        self._heartbeat_at = 0.0

    def run(self, seconds: float, step: float = STEP) -> None:
        """Lets `seconds` pass: sends heartbeats when due, polls, ticks and collects what was sent."""
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
        """Returns the events of this type that the link reported."""
        return [event for event in self.heard if isinstance(event, kind)]


def _near(wire: Wire) -> Transport:
    return wire.near


class FileClient:
    """Sends single MAVLink FTP requests and collects the replies; it checks and repeats nothing by itself."""

    def __init__(self, stage: LoopbackLink, sender: SenderId = (255, 190)) -> None:
        self.stage = stage
        self.sender = sender
        self.sequence = 0
        self._seen = len(stage.sent("FILE_TRANSFER_PROTOCOL"))

    def request(
        self, opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int = 0
    ) -> FtpPayload:
        """Makes the next request. size: bytes asked for, where no data is sent."""
        self.sequence += 1
        return FtpPayload(self.sequence, session, opcode, size or len(data), offset=offset, data=data)

    def send(self, request: FtpPayload, *, target: SenderId = (1, COMPONENT_ID)) -> None:
        """Sends a request to the link."""
        self.stage.send(encode.file_transfer(request.pack(), target), self.sender)

    def replies(self, seconds: float = 0.3) -> list[FtpPayload]:
        """Lets time pass and returns the replies since the last call."""
        self.stage.run(seconds)
        messages = self.stage.sent("FILE_TRANSFER_PROTOCOL")
        new, self._seen = messages[self._seen :], len(messages)
        ours = [one for one in new if (one.target_system, one.target_component) == self.sender]
        return [FtpPayload.unpack(bytes(one.payload)) for one in ours]

    def ask(self, request: FtpPayload) -> FtpPayload:
        """Sends a request and returns the first reply. Raises IndexError when none comes."""
        self.replies(0.0)
        self.send(request)
        return self.replies()[0]

    def open(self, path: str, *, session: int = 0) -> FtpPayload:
        """Opens a file and returns the reply to OPEN_FILE_RO."""
        return self.ask(self.request(Opcode.OPEN_FILE_RO, path.encode(), session=session))

    def read(self, *, session: int = 0, offset: int = 0, size: int = 80) -> FtpPayload:
        """Reads from the open file and returns the reply to READ_FILE."""
        return self.ask(self.request(Opcode.READ_FILE, session=session, offset=offset, size=size))
