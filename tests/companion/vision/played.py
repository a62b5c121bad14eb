"""A supervisor's `VisionClient` over a played child, without a daemon."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from anytraverse.engine import AnyTraverse
from anytraverse.judging import Settings
from anytraverse.memory import Memory, first_memory
from anytraverse.preferences import Preferences
from companion.config import Config
from companion.sim.loopback_vision import LoopbackVision
from companion.tasks import VISION
from companion.vision.checks import Expected, check_report
from companion.vision.client import VisionClient
from companion.vision.codec import Splitter, decode, encode
from companion.vision.messages import Report
from tests.anytraverse.conftest import Painted

WORDS = Preferences.parse("grass: 1; rock: -1")
Said = TypeVar("Said", bound=Report)


def engine(memory: Memory | None, perceiver: Painted | None = None) -> AnyTraverse:
    """Painted eyes on a memory, None: none was ever kept."""
    perceiver = perceiver or Painted()
    return AnyTraverse(perceiver, Settings(), memory or first_memory(perceiver.model_id, WORDS))


def unframed(report: Report) -> bytes:
    """Encoded, without the length."""
    (packed,) = Splitter().feed(encode(report))
    return packed


def heard(report: Said, expected: Expected | None = None) -> Said:
    """As the supervisor reads it, where it believes it."""
    read = check_report(decode(unframed(report)), expected or Expected(0, {0: Settings()}), time.monotonic())
    assert isinstance(read, type(report))
    return read


@contextlib.contextmanager
def loading(
    make: Callable[[Memory | None], AnyTraverse] = engine,
) -> Iterator[tuple[VisionClient, LoopbackVision]]:
    """A vision process that is asked to start with the first poll, and its child."""
    child = LoopbackVision(make)
    vision = VisionClient(lambda: child, Config(), None, VISION)
    try:
        yield vision, child
    finally:
        vision.close()
