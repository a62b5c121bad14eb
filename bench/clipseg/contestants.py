"""Defines the contestants: how each is made in a process of its own, and what it answers."""

from __future__ import annotations

import importlib
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bench.clipseg.frames import PROMPTS, make_frame
from bench.clipseg.parts import Parts

WARM_UP = 0
"""Index of the frame that is not measured."""


@dataclass(frozen=True)
class StepFigures:
    """A step's results, to see that all contestants do the same: ROI means in [0, 1], a unit vector."""

    roi_traversability: float
    roi_uncertainty: float
    embedding: tuple[float, ...]


class Contestant(Protocol):
    """One way to turn frames into pooled maps, ROI figures and a scene embedding."""

    parts: Parts

    def set_prompts(self, words: Sequence[str], weights: Sequence[float]) -> None:
        """Sets the prompts from the next step on, each word with its weight in [-1, 1]."""

    def figures(self, frame: NDArray[np.uint8]) -> StepFigures:
        """Runs one step on an RGB frame, (height, width, 3) uint8."""


@dataclass(frozen=True)
class ContestantPlan:
    """How to make a contestant. name: in the tables. factory: "module:callable" that takes `options`."""

    name: str
    factory: str
    options: dict[str, Any] = field(default_factory=dict)

    def make(self) -> Contestant:
        module, _, attribute = self.factory.partition(":")
        maker: Callable[..., Contestant] = getattr(importlib.import_module(module), attribute)
        return maker(**self.options)


@dataclass(frozen=True)
class Request:
    """One step: `count` prompts, a frame of (width, height) pixels."""

    size: tuple[int, int]
    count: int
    index: int


@dataclass(frozen=True)
class Sample:
    """What one step took, in seconds of process CPU and of the clock, and its results."""

    cpu: float
    wall: float
    parts: dict[str, float]
    figures: StepFigures
    peak_mb: float
    """The process's highest resident memory so far, 10^6 bytes."""


def serve(connection: Connection, plan: ContestantPlan) -> None:
    """Runs a contestant's process: sends "ready", answers each request with a sample, ends on None.

    It answers an error with its text, and ends.
    """
    try:
        contestant = plan.make()
        connection.send("ready")
        while (request := connection.recv()) is not None:
            connection.send(_step(contestant, request))
    except EOFError:  # the benchmark is gone
        return
    except Exception as error:
        connection.send(f"{plan.name}: {type(error).__name__}: {error}")


def _step(contestant: Contestant, request: Request) -> Sample:
    frame = make_frame(*request.size, request.index)
    words = list(PROMPTS)[: request.count]
    contestant.set_prompts(words, [PROMPTS[word] for word in words])
    contestant.parts.take()
    wall, cpu = time.perf_counter(), time.process_time()
    figures = contestant.figures(frame)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return Sample(cpu, wall, contestant.parts.take(), figures, _peak_mb())


def _peak_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
