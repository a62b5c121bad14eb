"""Drives along the simulated trail: pairs of frames, and a recording of them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import Writer

from companion.desk.ground.mount_fit import FramePair, grey
from companion.observers.recording.contents import image
from companion.observers.recording.topics import TOPICS, Topic
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose

NS = 1_000_000_000
BEGAN = 1_790_000_000
START = 35.0
"""Metres along the trail from which it is nearly straight."""
CONFIG = '[vehicle]\nfile = ""\n[camera]\nview = 75.0\n'
"""The simulated camera's lens. Its mount: 1.0 m, 7.0 degrees."""


def degrees_turned(first: TrailPose, second: TrailPose) -> float:
    """Clockwise."""
    return -math.degrees(math.remainder(second.heading - first.heading, 2 * math.pi))


def pairs(seed: int, step: float, most: int) -> Iterator[FramePair]:
    """Straight pairs along a lap."""
    world = World(seed)
    camera = PinholeCamera(world, seed=seed)
    count = 0
    for place in np.arange(5.0, 120.0, 1.5):
        first, second = (world.trail.pose(float(at)) for at in (place, place + step))
        turned = degrees_turned(first, second)
        if abs(turned) > 2.0 or count == most:
            continue
        count += 1
        one, other = camera.render(first, place)[0], camera.render(second, place + step)[0]
        yield FramePair(grey(one), grey(other), math.hypot(second.x - first.x, second.y - first.y), turned)


@lru_cache(1)
def _camera(seed: int) -> PinholeCamera:
    return PinholeCamera(World(seed), seed=seed)


def record(
    path: Path,
    seed: int,
    *,
    frames: int,
    speed: float | None = 0.8,
    rate: float = 2.0,
    words: Mapping[str, float] | None = None,
    posed: bool = False,
) -> None:
    """Write a recording of a drive at 0.8 m/s, as a companion does. speed: as the autopilot reports it.

    words: by which it was judged. posed: whether frames have their pose.
    """
    camera = _camera(seed)
    world = camera.world
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {
            topic: writer.register_channel(TOPICS[topic].name, TOPICS[topic].encoding, 0)
            for topic in (Topic.CAMERA, Topic.ASSESSMENT, Topic.VEHICLE, Topic.WORDS)
        }

        def add(topic: Topic, at: float, data: bytes, number: int = 0) -> None:
            logged = round((BEGAN + at) * NS)
            writer.add_message(channels[topic], logged, data, logged, number)

        if words is not None:
            add(Topic.WORDS, 0.0, json.dumps({"words": words}).encode())
        for number in range(frames):
            at = number / rate
            pose = world.trail.pose(START + 0.8 * at)
            picture, _ = camera.render(pose, at)
            jpeg = cv2.imencode(".jpg", picture[..., ::-1])[1].tobytes()
            add(Topic.CAMERA, at, image(jpeg, "jpeg", round((BEGAN + at) * NS)), number + 1)
            judged: dict[str, Any] = {"frame": number + 1, "captured_at": 300.0 + at}
            if posed:
                judged["pose"] = [pose.x, pose.y, math.degrees(pose.heading)]
            add(Topic.ASSESSMENT, at + 0.1, json.dumps(judged).encode(), number + 1)
        for number in range(round(4 * frames / rate)):
            at = number / 4
            yaw = -math.degrees(world.trail.pose(START + 0.8 * at).heading) % 360
            reported = {"position_at": 300.0 + at, "speed": speed}
            attitude = {"attitude_at": 300.0 + at, "attitude": [0.0, 0.0, yaw]}
            add(Topic.VEHICLE, at + 0.05, json.dumps({**reported, **attitude}).encode())
        writer.finish()
