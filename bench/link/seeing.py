"""The whole daemon with the builtin perceiver at work: how soon a judged frame's summary is on the wire."""

from __future__ import annotations

import contextlib
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.link.drive import at
from bench.link.lossy import Autopilot
from bench.link.rover import Companion, PlayedCamera
from companion.eyes import Eyes, Judged, Result
from companion.link.settings import Address
from companion.link.transport import Transport, Udp
from companion.wire.ids import TUNNEL_SUMMARY
from companion.wire.payloads import Summary

HOST = "127.0.0.1"
FRAME_RATE = 10.0
START = 3.0
"""s that do not count: the journal is made, and an autopilot is met."""
_TUNNEL = 385
_WORDS = Preferences.parse("grass: 1; dirt: 1")
_CALM = Thresholds(roi=1.0, scene=-1.0, tile=None, trav=0.0)


class Stamped:
    """A UDP transport; `told` keeps when the summary of a frame left."""

    datagrams = True

    def __init__(self, udp: Transport) -> None:
        self._udp = udp
        self.told: dict[int, float] = {}

    def read(self) -> bytes:
        return self._udp.read()

    def write(self, frame: bytes) -> bool:
        taken = self._udp.write(frame)
        if taken and int.from_bytes(frame[7:10], "little") == _TUNNEL:
            payload = frame[15:-2].ljust(128, b"\0")
            if int.from_bytes(frame[10:12], "little") == TUNNEL_SUMMARY:
                self.told[Summary.unpack(payload[: frame[14]]).frame_id] = time.monotonic()
        return taken

    def believe(self, now: float, *, autopilot: bool) -> None:
        self._udp.believe(now, autopilot=autopilot)

    def fileno(self) -> int | None:
        return self._udp.fileno()

    def close(self) -> None:
        self._udp.close()


class Ground:
    """Somebody who listens, and the autopilot, at one UDP port."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self._socket.settimeout(0)
        self._companion: Any = None
        self._autopilot = Autopilot()

    @property
    def address(self) -> Address:
        """Where the companion speaks to."""
        return Address("udpout", HOST, int(self._socket.getsockname()[1]))

    def step(self, now: float) -> None:
        """Hear all, and say the autopilot's heartbeat."""
        with contextlib.suppress(BlockingIOError):
            while True:
                _, self._companion = self._socket.recvfrom(4096)
        if self._companion is not None:
            for frame in self._autopilot.says(now):
                self._socket.sendto(frame, self._companion)

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


class Lens(PlayedCamera):
    """Ten frames a second of a field of noise, as a `FrameSource`."""

    def __init__(self) -> None:
        super().__init__()
        random = np.random.default_rng(1)
        self._pictures = [random.integers(1, 255, (480, 640, 3), dtype=np.uint8) for _ in range(8)]
        self._number = 0
        self._due = time.monotonic()

    def take(self, timeout: float) -> Frame | None:
        """The next one when it is due."""
        now = time.monotonic()
        if self._due > now + timeout:
            time.sleep(timeout)
            return None
        time.sleep(max(0.0, self._due - now))
        self._due = max(self._due + 1 / FRAME_RATE, time.monotonic())
        self._number += 1
        self.delivered_at = captured = time.monotonic()
        return Frame(self._number, captured, self._pictures[self._number % 8])


class TimedEyes(Eyes):
    """The daemon's own, in their thread; `judged` keeps when each frame was."""

    def __init__(self, engine: AnyTraverse, camera: Lens) -> None:
        super().__init__(engine, camera, 1 / FRAME_RATE)
        self.judged: dict[int, float] = {}

    def results(self) -> list[Result]:
        """As ever, and timed."""
        results = super().results()
        for one in results:
            if isinstance(one, Judged):
                self.judged[one.assessment.frame.id] = one.at
        return results


def seeing(rate: float, seconds: float, folder: Path) -> dict[str, Any]:
    """At so many summaries a second, ten frames a second and one core for the network."""
    perceiver = make_perceiver("builtin", Runtime(threads=1))
    engine = AnyTraverse(perceiver, Settings(thresholds=_CALM), first_memory(perceiver.model_id, _WORDS))
    lens, ground = Lens(), Ground()
    eyes, wire = TimedEyes(engine, lens), Stamped(Udp(ground.address))
    companion = Companion(folder, lambda: wire, engine, eyes, lens)
    companion.link.set_rate("summary", rate)
    eyes.start()
    try:
        _run_for(START, companion, ground)
        eyes.judged.clear()
        wire.told.clear()
        loop = time.thread_time()
        _run_for(seconds, companion, ground)
        loop = time.thread_time() - loop
    finally:
        companion.close()
        ground.close()
    late = [1e3 * (left - eyes.judged[number]) for number, left in wire.told.items() if number in eyes.judged]
    return {
        "frames_per_s": round(len(eyes.judged) / seconds, 1),
        "summaries": len(late),
        "judged_to_wire_ms": {"p50": at(late, 0.5), "p99": at(late, 0.99), "max": at(late, 1.0)},
        "loop_share": round(100 * loop / seconds, 2),
    }


def _run_for(seconds: float, companion: Companion, ground: Ground) -> None:
    until = time.monotonic() + seconds
    while (now := time.monotonic()) < until:
        ground.step(now)
        companion.turn()
