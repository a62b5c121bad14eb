"""Measures how soon a summary is on the wire in the whole daemon with its vision process and `builtin`."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from anytraverse.judging import Settings, Thresholds
from bench.link.drive import at
from bench.link.lossy import StreamingAutopilot
from bench.link.rover import Companion
from companion.config import Config
from companion.config.link_settings import Address
from companion.config.schema import CameraSection, PerceiverSection
from companion.link.transport import Transport, Udp
from companion.tasks import VISION
from companion.vision.child import VisionChild
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import FrameJudged
from companion.wire.ids import TUNNEL_SUMMARY
from companion.wire.payloads import Summary

HOST = "127.0.0.1"
FRAME_RATE = 10.0
START = 3.0
"""s that do not count: the journal is made, and the autopilot is found."""
LOADED_WITHIN = 60.0
_TUNNEL = 385
_WORDS = {"grass": 1.0, "dirt": 1.0}
_CALM = Thresholds(roi=1.0, scene=-1.0, tile=None, trav=0.0)


class Stamped:
    """A UDP transport; `told` stores when the summary of a frame left."""

    datagrams = True
    rate = math.inf

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

    def check(self, now: float) -> None:
        self._udp.check(now)

    def idle(self) -> bool:
        return self._udp.idle()

    def note_revocable(self) -> None:
        self._udp.note_revocable()

    def settled(self) -> bool:
        return self._udp.settled()

    def has_room(self) -> bool:
        return self._udp.has_room()

    def recall(self) -> None:
        self._udp.recall()

    def note_accepted(self, now: float, *, autopilot: bool) -> None:
        self._udp.note_accepted(now, autopilot=autopilot)

    def fileno(self) -> int | None:
        return self._udp.fileno()

    def close(self) -> None:
        self._udp.close()


class _Ground:
    """A listener and the autopilot at one UDP port."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self._socket.settimeout(0)
        self._companion: Any = None
        self._autopilot = StreamingAutopilot()

    @property
    def address(self) -> Address:
        """The address to which the companion sends."""
        return Address("udpout", HOST, int(self._socket.getsockname()[1]))

    def step(self, now: float) -> None:
        """Reads all that came in, and sends the autopilot's heartbeat."""
        with contextlib.suppress(BlockingIOError):
            while True:
                _, self._companion = self._socket.recvfrom(4096)
        if self._companion is not None:
            for frame in self._autopilot.says(now):
                self._socket.sendto(frame, self._companion)

    def close(self) -> None:
        """Closes the port."""
        self._socket.close()


class TimedVision(VisionClient):
    """The daemon's vision client; `judged` stores when each frame was judged, by the one monotonic clock."""

    judged: dict[int, float]

    def poll(self, now: float) -> list[VisionResult]:
        """Polls as usual, and takes the time of each judged frame."""
        results = super().poll(now)
        for one in results:
            if isinstance(one.report, FrameJudged):
                self.judged[one.report.assessment.frame.id] = one.report.at
        return results


def seeing(rate: float, seconds: float, folder: Path) -> dict[str, Any]:
    """Measures at so many summaries a second, with ten frames a second and one core for the network."""
    config = Config(
        camera=CameraSection(f"folder:{_noise(folder / 'noise')}", FRAME_RATE, FRAME_RATE, loop=True),
        perceiver=PerceiverSection("builtin", threads=1),
        words=_WORDS,
    )
    ground = _Ground()
    vision, wire = TimedVision(VisionChild, config, None, VISION), Stamped(Udp(ground.address))
    vision.judged = {}
    try:
        _load(vision)
        companion = Companion(folder, lambda: wire, vision, Settings(thresholds=_CALM))
        companion.link.set_rate("summary", rate)
        try:
            _run_for(START, companion, ground)
            vision.judged.clear()
            wire.told.clear()
            loop = time.thread_time()
            _run_for(seconds, companion, ground)
            loop = time.thread_time() - loop
        finally:
            companion.close()
    finally:
        vision.close()
        ground.close()
    judged = vision.judged
    late = [1e3 * (left - judged[number]) for number, left in wire.told.items() if number in judged]
    return {
        "frames_per_s": round(len(judged) / seconds, 1),
        "summaries": len(late),
        "judged_to_wire_ms": {"p50": at(late, 0.5), "p99": at(late, 0.99), "max": at(late, 1.0)},
        "loop_share": round(100 * loop / seconds, 2),
    }


def _noise(folder: Path) -> Path:
    """Makes eight pictures of noise for a camera."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(1)
    for number in range(8):
        picture = random.integers(1, 255, (480, 640, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number}.jpg"), picture)
    return folder


def _load(vision: VisionClient) -> None:
    until = time.monotonic() + LOADED_WITHIN
    while vision.ready is None:
        vision.poll(time.monotonic())
        if vision.failed or time.monotonic() > until:
            raise RuntimeError(f"the vision process is not ready: {vision.failed or vision.trouble}")
        time.sleep(0.02)


def _run_for(seconds: float, companion: Companion, ground: _Ground) -> None:
    until = time.monotonic() + seconds
    while (now := time.monotonic()) < until:
        ground.step(now)
        companion.turn()
