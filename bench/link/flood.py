"""Floods a link on real sockets in real time from a second process, and measures who still gets through.

The second process is also autopilot and operator; each of them sends from a port of its own, as the floods
do.
"""

from __future__ import annotations

import contextlib
import gc
import math
import multiprocessing
import select
import socket
import sys
import tempfile
import time
from array import array
from dataclasses import asdict, dataclass, field
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from bench.link.frame import framed
from companion.config.link_settings import MAIN, Address, LinkSettings
from companion.link.inbound import VehicleUpdate
from companion.link.link import Link
from companion.link.signing import Signing, open_signing
from companion.link.transport import Udp
from companion.wire import signing
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import TUNNEL_ANSWER, Motion, Outcome, Reasons, Result, Stage
from companion.wire.parameters import build

HOST = "127.0.0.1"
SECRET = bytes(range(32))
AUTOPILOT, OPERATOR = (1, 1), (255, 190)
BEAT = 0.2
"""s between the autopilot's heartbeats; each carries the time at which it left."""
ASK_EVERY, ASK_AGAIN = 0.5, 1.0
PORTS = 8
ALONE = 2.0
"""s before the flood begins, in which the link learns autopilot and operator."""
TICK = 0.02
BEATS_WITHIN, HEARD_WITHIN = 1.3, 0.3
MORE_BLOCKS = 4000
"""Memory blocks by which it may grow, for tables of bounded size that are not full at first."""
_TUNNEL, _ACK = 385, 45004


@dataclass(frozen=True)
class Flood:
    """A kind of flood. rate: datagrams a second, 0 for none."""

    rate: float
    datagrams: tuple[bytes, ...] = (b"",)


@dataclass
class Flooded:
    """The result of a flood; in s, unless said otherwise.

    turn_p99, turn_max: from waking to the next wait. heard_max: from an autopilot's heartbeat to the link's
    event for it. beat_max: longest gap between the companion's heartbeats at the autopilot. asked, told: the
    operator's answers, and how many of them were acknowledged; told_max: the slowest. granted: answers of
    others that were let through. cpu: share of a core. blocks: memory blocks taken in the second half.
    """

    poured: int = 0
    turn_p99: float = 0.0
    turn_max: float = 0.0
    heard_max: float = 0.0
    beat_max: float = 0.0
    asked: int = 0
    told: int = 0
    told_max: float = 0.0
    granted: int = 0
    cpu: float = 0.0
    blocks: int = 0
    rejected: dict[str, int] = field(default_factory=dict)


def floods() -> dict[str, Flood]:
    """Returns the floods by name. many: 2,816 senders, each allowed to answer. one: a single one of them."""
    everybody = list(product(range(245, 256), range(256)))
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return {
        "quiet": Flood(0.0),
        "junk": Flood(300.0, (b"x",)),
        "noise": Flood(50.0, (b"\xfe" * 60_000,)),
        "one": Flood(2000.0, _answers([(250, 7)])),
        "many": Flood(2000.0, _answers(everybody)),
        "heartbeats": Flood(2000.0, tuple(framed(heartbeat, *ids) for ids in everybody)),
        "torrent": Flood(20_000.0, _answers(everybody)),
    }


def good(flooded: Flooded) -> bool:
    """Whether the promises were kept: heartbeats, the autopilot heard, the operator answered, memory flat."""
    in_time = flooded.beat_max <= BEATS_WITHIN and flooded.heard_max <= HEARD_WITHIN
    return in_time and flooded.asked - flooded.told <= 1 and flooded.blocks <= MORE_BLOCKS


def run(name: str, seconds: float, *, signed: bool = False) -> Flooded:
    """Runs one flood for `seconds`. signed: link, autopilot and operator have a key, the flood has none."""
    with tempfile.TemporaryDirectory(prefix="atl-") as folder:
        return _run(name, seconds, _signing(Path(folder)) if signed else None)


def _run(name: str, seconds: float, key: Signing | None) -> Flooded:
    udp = Udp(Address("udpin", HOST, 0))
    settings = LinkSettings(f"udpin:{HOST}:0")
    link = Link(
        settings, build(["grass"], {}, {}), time.monotonic(), openers={MAIN: lambda: udp}, signing=key
    )
    queue: Any = multiprocessing.get_context("spawn").Queue()
    outside = multiprocessing.get_context("spawn").Process(
        target=_live, args=(queue, udp.port, name, seconds, key is not None), daemon=True
    )
    outside.start()
    measured, turns = Flooded(), array("d", [0.0])
    began = cpu = math.inf
    blocks = 0
    with contextlib.suppress(OSError):
        while outside.is_alive():
            select.select(link.filenos(), [], [], min(TICK, link.wait(time.monotonic())))
            now = time.monotonic()
            for event in link.poll(now):
                match event:
                    case Answer():
                        measured.granted += event.sender != OPERATOR
                        link.answers.acknowledge(event, _granted(event), now)
                    case VehicleUpdate(vehicle):
                        if began == math.inf:
                            began, cpu = now, time.process_time()
                        late = max(0, int(now * 1000) % (1 << 32) - vehicle.custom_mode) / 1000
                        measured.heard_max = max(measured.heard_max, time.monotonic() - now + late)
            link.tick(now)
            if now > began:
                turns.append(time.monotonic() - now)
            if now > began + ALONE + seconds / 2 and not blocks:
                gc.collect()
                blocks = sys.getallocatedblocks()
            if not queue.empty():
                break
    measured.cpu = round((time.process_time() - cpu) / (time.monotonic() - began), 3)
    gc.collect()
    measured.blocks = sys.getallocatedblocks() - blocks
    measured.turn_p99 = sorted(turns)[int(0.99 * len(turns))]
    measured.turn_max = max(turns)
    measured.rejected = dict(link.counters.rejected)
    for figure, value in queue.get(timeout=10.0).items():
        setattr(measured, figure, value)
    outside.join(10.0)
    link.close()
    return measured


class Outside:
    """Plays autopilot, operator and flood, each on sockets of its own."""

    def __init__(self, port: int, flood: Flood, *, signed: bool) -> None:
        self._there = (HOST, port)
        self._flood = flood
        self._poured, self._next = 0, cycle(flood.datagrams)
        self._autopilot, self._operator, *self._others = (_socket() for _ in range(2 + PORTS))
        self._key = signing.SigningKey(SECRET) if signed else None
        self._stamp = signing.ticks(time.time())
        self._asked_at, self._first_asked = -math.inf, -math.inf
        self._transaction, self._pending = 0, False
        self._beat_at = self._operator_beat_at = -math.inf
        self._came_at: list[float] = []
        self.measured = Flooded()

    def live(self, seconds: float) -> dict[str, Any]:
        """Runs the second process, and returns the figures that it measured."""
        began = time.monotonic()
        while (now := time.monotonic()) < began + ALONE + seconds:
            self._send_autopilots_heartbeat(now)
            self._send_operators_requests(now)
            self._send_flood(now - began - ALONE)
            self._listen(now)
            time.sleep(0.002)
        gaps = [b - a for a, b in zip(self._came_at, [*self._came_at[1:], now], strict=True)]
        measured = self.measured
        measured.beat_max = max(gaps, default=math.inf)
        if self._pending:
            measured.told_max = max(measured.told_max, now - self._first_asked)
        return {name: getattr(measured, name) for name in ("poured", "beat_max", "asked", "told", "told_max")}

    def _send_flood(self, elapsed: float) -> None:
        due = int(elapsed * self._flood.rate) - self.measured.poured
        for datagram in islice(self._next, max(0, due)):
            self._others[self.measured.poured % PORTS].sendto(datagram, self._there)
            self.measured.poured += 1

    def _send_autopilots_heartbeat(self, now: float) -> None:
        if now - self._beat_at >= BEAT:
            self._beat_at = now
            mode = int(now * 1000) % (1 << 32)
            self._send(self._autopilot, mavlink.MAVLink_heartbeat_message(10, 3, 129, mode, 4, 3), AUTOPILOT)

    def _send_operators_requests(self, now: float) -> None:
        if now - self._operator_beat_at >= 1.0:
            self._operator_beat_at = now
            self._send(self._operator, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), OPERATOR)
        if now - self._asked_at < (ASK_AGAIN if self._pending else ASK_EVERY):
            return
        self._asked_at = now
        if not self._pending:
            self._transaction, self._pending, self._first_asked = self._transaction + 1, True, now
            self.measured.asked += 1
        self._send(self._operator, _answer(self._transaction), OPERATOR)

    def _listen(self, now: float) -> None:
        for frame in _received(self._autopilot):
            if frame[7:10] == b"\0\0\0":
                self._came_at.append(now)
        for frame in _received(self._operator):
            if int.from_bytes(frame[7:10], "little") != _TUNNEL or frame[12] != OPERATOR[0]:
                continue
            if int.from_bytes(frame[10:12], "little") == _ACK:
                ack = Acknowledgement.unpack(frame[15 : 15 + frame[14]].ljust(frame[14], b"\0"))
                if self._pending and ack.transaction == self._transaction:
                    self._pending = False
                    self.measured.told += 1
                    self.measured.told_max = max(self.measured.told_max, now - self._first_asked)

    def _send(self, by: socket.socket, message: Any, ids: tuple[int, int]) -> None:
        frame = framed(message, *ids)
        if self._key is not None:
            self._stamp += 1
            frame = self._key.sign(frame, message.crc_extra, by.getsockname()[1] % 256, self._stamp)
        by.sendto(frame, self._there)


def _live(queue: Any, port: int, name: str, seconds: float, signed: bool) -> None:
    queue.put(Outside(port, floods()[name], signed=signed).live(seconds))


def _answers(senders: list[tuple[int, int]]) -> tuple[bytes, ...]:
    return tuple(
        framed(_answer(1 + number % 60_000), *sender) for number, sender in zip(range(20_000), cycle(senders))
    )


def _answer(transaction: int) -> Any:
    payload = Answer(0, Motion.STAY, transaction=transaction).pack()
    return mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), payload.ljust(128, b"\0"))


def _granted(request: Answer) -> Acknowledgement:
    return Acknowledgement(
        request.transaction, request.target, Result.APPLIED, Stage.CLOSED, Outcome.NONE,
        None, None, Reasons.NONE, 0, "noted",
    )  # fmt: skip


def _signing(folder: Path) -> Signing:
    path = folder / "key"
    path.touch(0o600)
    path.write_bytes(SECRET)
    return open_signing(path, folder)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((HOST, 0))
    made.settimeout(0)
    return made


def _received(by: socket.socket) -> list[bytes]:
    frames = []
    with contextlib.suppress(BlockingIOError):
        while True:
            frames.append(by.recv(4096))
    return frames


def figures(flooded: Flooded) -> dict[str, Any]:
    """For the report."""
    told = asdict(flooded).items()
    return {name: round(value, 3) if isinstance(value, float) else value for name, value in told}
