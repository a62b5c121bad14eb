"""How fast the link is: frames handled, what it costs at rest, and how soon a summary is on the wire."""

from __future__ import annotations

import os
import select
import socket
import time
from dataclasses import replace
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
from bench.link.mutants import genuine
from bench.link.rover import Companion, PlayedCamera
from companion.eyes import Eyes, Judged, Result
from companion.link.link import Link
from companion.link.memory import pair
from companion.link.settings import MAIN, Address, LinkSettings
from companion.link.transport import Transport, Udp, opener
from companion.wire.ids import TUNNEL_SUMMARY, Policy, Reasons, State
from companion.wire.parameters import build
from companion.wire.payloads import Summary

HOST = "127.0.0.1"
FRAMES = 20_000
FRAME_RATE = 10.0
TICK = 0.02
_TUNNEL = 385
_WORDS = Preferences.parse("grass: 1; dirt: 1")
_SUMMARY = Summary(
    State.OK, Policy.REPORT, Reasons.NONE, 0, 0, 1, 100, 80, 0.8, 0.1, 0.2, 0.95, 90, 7, 0, (0.5,) * 16
)
_CALM = Thresholds(roi=1.0, scene=-1.0, tile=None, trav=0.0)


def handled(frames: int = FRAMES) -> dict[str, float]:
    """Genuine requests and telemetry, answered; CPU of one core."""
    near, far = pair()
    settings = LinkSettings(f"udpout:{HOST}:14550", asked_budget=0.0, pace=0.0)
    link = Link(settings, build(["grass"], {}, {}), 0.0, openers={MAIN: lambda: near})
    waiting = [genuine(number) for number in range(frames)]
    now, answered, began = 0.0, 0, time.process_time()
    for number, frame in enumerate(waiting):
        far.write(frame)
        if number % 4 == 3:
            now += 0.2
            link.poll(now)
            link.tick(now)
            while far.read():
                answered += 1
    took = time.process_time() - began
    return {
        "frames_per_s": round(frames / took),
        "us_a_frame": round(1e6 * took / frames, 1),
        "sent": answered,
    }


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

    def fileno(self) -> int | None:
        return self._udp.fileno()

    def close(self) -> None:
        self._udp.close()


def share_at(rate: float, seconds: float) -> float:
    """CPU of one core, in per cent, that the link alone takes at so many summaries a second."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind((HOST, 0))
        address = Address("udpout", HOST, int(ground.getsockname()[1]))
        began = time.monotonic()
        link = Link(
            LinkSettings("udpout:127.0.0.1:1"),
            build(["grass"], {}, {}),
            began,
            openers={MAIN: opener(address)},
        )
        link.set_rate("summary", rate)
        cpu, frame_at, number = time.process_time(), began, 0
        while (now := time.monotonic()) < began + seconds:
            if now >= frame_at:
                frame_at, number = frame_at + 1 / FRAME_RATE, number + 1
                link.summary(replace(_SUMMARY, frame_id=number), now)
            link.poll(now)
            link.tick(now)
            select.select(link.filenos(), [], [], min(TICK, link.wait(now)))
        cpu = time.process_time() - cpu
        link.close()
    return round(100 * cpu / seconds, 2)


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
    """The whole daemon with the builtin perceiver at work: from a judged frame to its summary on the wire."""
    perceiver = make_perceiver("builtin", Runtime(threads=1))
    engine = AnyTraverse(perceiver, Settings(thresholds=_CALM), first_memory(perceiver.model_id, _WORDS))
    lens = Lens()
    eyes = TimedEyes(engine, lens)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind((HOST, 0))
        wire = Stamped(Udp(Address("udpout", HOST, int(ground.getsockname()[1]))))
        companion = Companion(folder, lambda: wire, engine, eyes, lens)
        companion.link.set_rate("summary", rate)
        eyes.start()
        try:
            until, loop = time.monotonic() + seconds, time.thread_time()
            while time.monotonic() < until:
                companion.turn()
            loop = time.thread_time() - loop
        finally:
            companion.close()
    late = [1e3 * (at_ - eyes.judged[number]) for number, at_ in wire.told.items() if number in eyes.judged]
    return {
        "frames_per_s": round(len(eyes.judged) / seconds, 1),
        "summaries": len(late),
        "judged_to_wire_ms": {"p50": at(late, 0.5), "p99": at(late, 0.99), "max": at(late, 1.0)},
        "loop_share": round(100 * loop / seconds, 2),
    }


def run(seconds: float, folder: Path) -> dict[str, Any]:
    """All of it, `seconds` s for each figure; load: what else the machine did in the last minute."""
    return {
        "handled": handled(),
        "share_at_1_hz": share_at(1.0, seconds),
        "share_at_5_hz": share_at(5.0, seconds),
        "seeing_at_1_hz": seeing(1.0, 2 * seconds, folder / "1"),
        "seeing_at_5_hz": seeing(5.0, 2 * seconds, folder / "5"),
        "load": round(os.getloadavg()[0], 1),
        "cores": len(os.sched_getaffinity(0)),
    }
