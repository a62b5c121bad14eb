"""Measures a frame by its size: judged by the built-in network, and made into each picture that is stored."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from anytraverse.assessment import Assessment
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.growth.words import judge_new
from bench.series import PlottedSeries, cpu_ms
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.vision.messages import Encode
from companion.vision.pictures import encoded, panel, thumbnail, to_png, unmarked
from companion.wire.ids import State

SIZES = ((320, 240), (640, 480), (1280, 720), (1920, 1080), (2560, 1440), (3840, 2160))
_WORDS = Preferences.parse("trail: 1; grass: 1; bush: -1; sky: -1")
_GRAIN = 3.0
"""Grey values of a sensor's noise: without it a PNG would be smaller than a camera's."""


def measure(*, quick: bool, bundle: Path | None) -> list[PlottedSeries]:
    """Measures up to 3840x2160; quick: up to 1920x1080. `bundle` is not needed."""
    del bundle
    cv2.setNumThreads(1)
    perceiver = make_perceiver("builtin", Runtime(threads=1))
    memory = first_memory(perceiver.model_id, _WORDS)
    engine = AnyTraverse(perceiver, Settings.of(perceiver.defaults), memory)
    engine.step(Frame(1, 0.0, _picture(640, 480)), 0.0)  # which becomes the reference
    times = PlottedSeries("Time by frame size", "megapixels", "ms of CPU")
    bytes_ = PlottedSeries("Bytes by frame size", "megapixels", "kB")
    for width, height in SIZES[:4] if quick else SIZES:
        frame = Frame(1, 0.0, _picture(width, height))
        pixels = round(width * height / 1e6, 3)
        seen = engine.judge(engine.observe(frame), 0.0)
        rounds = 3 if quick else 7
        times.add("encode and embed", pixels, cpu_ms(partial(engine.observe, frame), rounds))
        assert seen.observation is not None
        times.add("attend and judge", pixels, cpu_ms(partial(judge_new, engine, seen.observation), rounds))
        for name, make in _pictures(seen, engine).items():
            bytes_.add(name, pixels, [len(make()) / 1e3])
            times.add(name, pixels, cpu_ms(make, rounds))
        print(f"{width}x{height}: encoded in {times.lines['encode and embed'][-1][1]} ms", flush=True)
    return [times, bytes_]


def _pictures(seen: Assessment, engine: AnyTraverse) -> dict[str, Callable[[], bytes]]:
    """Returns what makes each picture of a frame."""
    region = engine.settings.region
    return {
        "call's frame, PNG": lambda: to_png(seen.frame.image),
        "judged picture": lambda: panel(seen, State.CALLING, "C1", region),
        "thumbnail": lambda: thumbnail(seen, region),
        "unmarked picture": lambda: unmarked(seen.frame.image),
        "recorded frame": lambda: encoded(Encode(1, 1), seen).picture,
    }


def _picture(width: int, height: int) -> Image:
    """Renders the simulated trail, enlarged, with a sensor's noise."""
    world = World(1)
    image, _ = PinholeCamera(world, 640, 480).render(world.trail.pose(world.trail.start), 0.0)
    enlarged = cv2.resize(image, (width, height), interpolation=cv2.INTER_CUBIC)
    noise = np.random.default_rng(1).normal(0.0, _GRAIN, (height, width, 1)).astype(np.float32)
    return np.asarray(np.clip(enlarged + noise, 0, 255), np.uint8)
