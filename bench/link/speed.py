"""Measures how fast the link is: frames handled, CPU at rest, and how soon a summary is on the wire."""

from __future__ import annotations

import select
import socket
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.link.mutants import genuine
from bench.link.vision_latency import FRAME_RATE, HOST, seeing
from companion.config.link_settings import MAIN, Address, LinkSettings
from companion.link.link import Link
from companion.link.transport import opener
from companion.sim.loopback_link import pair
from companion.wire.ids import Policy, Reasons, State
from companion.wire.parameters import build
from companion.wire.payloads import Summary

FRAMES = 20_000
TICK = 0.02
_SUMMARY = Summary(
    State.OK, Policy.REPORT, Reasons.NONE, 0, 0, 1, 100, 80, 0.8, 0.1, 0.2, 0.95, 90, 7, 0, (0.5,) * 16
)


def handled(frames: int = FRAMES) -> dict[str, float]:
    """Measures how many genuine requests and telemetry frames one core handles and answers."""
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


def share_at(rate: float, seconds: float) -> float:
    """Measures the CPU of one core (%) that the link alone takes at so many summaries a second."""
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


def run(seconds: float, folder: Path) -> dict[str, Any]:
    """Runs all measurements, each CPU share over `seconds` s."""
    return {
        "handled": handled(),
        "share_at_1_hz": share_at(1.0, seconds),
        "share_at_5_hz": share_at(5.0, seconds),
        "seeing_at_1_hz": seeing(1.0, 6 * seconds, folder / "1"),
        "seeing_at_5_hz": seeing(5.0, 3 * seconds, folder / "5"),
    }
