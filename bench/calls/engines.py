"""Makes what a rover judges with: the shipped perceiver, the shipped configuration or the demo's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from anytraverse.engine import AnyTraverse
from anytraverse.perception.stored import PerceptionStore, StoredPerceiver
from anytraverse.resources import resource
from companion.config import Config, load_config
from companion.desk.tuning.trial import TrialEngine
from companion.sim.demo.config import write_config
from companion.vision.warm_up import load_engine


def shipped(rate: float) -> Config:
    """Return the configuration that ships, for a camera of `rate` frames/s and one core."""
    return _one_core(load_config(str(resource("config/companion.toml"))), rate)


def of_the_field(rate: float, speed: float) -> Config:
    """Return the demo's configuration: its words, region and mount. speed: m/s of the simulated rover."""
    with TemporaryDirectory(prefix="calls-") as folder:
        camera, link = "folder:none", "udpout:127.0.0.1:1"
        path = write_config(Path(folder), camera=camera, link=link, policy="shadow", speed=speed, rate=rate)
        return _one_core(load_config(str(path)), rate)


def engines(config: Config, count: int) -> list[TrialEngine]:
    """Return engines with new memories, which share what the perceiver sees of a frame."""
    cv2.setNumThreads(1)
    made, _ = load_engine(config, None)
    perceiver = StoredPerceiver(made.perceiver, _nothing_stored())
    return [TrialEngine(perceiver, made.settings, made.memory) for _ in range(count)]


def alone(config: Config) -> AnyTraverse:
    """Return an engine with a new memory and the perceiver itself."""
    cv2.setNumThreads(1)
    return load_engine(config, None)[0]


def _nothing_stored() -> PerceptionStore:
    """Return a store that keeps nothing on disk: each frame is seen once, by all engines in turn."""
    with TemporaryDirectory(prefix="calls-") as folder:
        return PerceptionStore(Path(folder), "", most=0)


def _one_core(config: Config, rate: float) -> Config:
    return replace(
        config,
        camera=replace(config.camera, rate=rate),
        perceiver=replace(config.perceiver, name="builtin", threads=1),
    )
