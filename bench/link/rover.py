"""Runs the rover's side: the daemon as it ships, with its journal; only camera and perceiver are simulated.

In virtual time (`Rover`) the vision process is simulated, too; `Companion` takes any.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

from msgspec.structs import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import Memory, first_memory
from anytraverse.operations import Operation
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from bench.link.synthetic_frames import GRASS, NumberPerceiver, picture
from companion.calls.decisions import Decision
from companion.calls.machine import OperatorCalls
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config, schema
from companion.config.link_settings import MAIN, LinkSettings
from companion.daemon.composition import Resources, compose
from companion.link.link import Link
from companion.link.transport import Transport
from companion.sim.loopback_vision import LoopbackVision
from companion.storage import Journal
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.wire.ids import Motion, Result
from companion.wire.parameters import build

FRAME_PERIOD = 0.25
_ROI = Box(0.333, 0.6, 0.667, 0.95)
_NOWHERE = "udpout:127.0.0.1:14550"


class Applied(NamedTuple):
    """An answer that reached the state machine, at `at` s."""

    at: float
    target: int
    motion: Motion
    result: Result


class CountedCalls(OperatorCalls):
    """The daemon's own state machine; `applied` stores every answer that reached it."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.applied: list[Applied] = []

    def apply_answer(
        self,
        target: int,
        motion: Motion,
        operations: Sequence[Operation],
        outcome: AnswerOutcome | None,
        now: float,
        *,
        go_at: float | None = None,
    ) -> tuple[Result, list[Decision]]:
        """Handles an answer as usual, and stores it in `applied`."""
        result, decisions = super().apply_answer(target, motion, operations, outcome, now, go_at=go_at)
        self.applied.append(Applied(now, target, motion, result))
        return result, decisions


class CountedVision(VisionClient):
    """The daemon's own vision client; `asked` stores the answers that it accepted."""

    asked: list[object]

    def answer(self, token: object, operations: Any, **given: Any) -> bool:
        """Passes an answer to vision as usual, and stores it in `asked` if it was accepted."""
        taken = super().answer(token, operations, **given)
        if taken:
            self.asked.append(token)
        return taken


class Companion:
    """The daemon as `companion run` composes it. Call `turn` some 50 times a second."""

    def __init__(
        self,
        folder: Path,
        opener: Callable[[], Transport],
        vision: VisionClient,
        settings: Settings | None = None,
        *,
        policy: str = "report",
        pictures: int = 0,
    ) -> None:
        """vision: must be ready. settings: to judge by; by default those of the configuration.

        pictures: how many are stored.
        """
        now, ready = time.monotonic(), vision.ready
        assert ready is not None
        words = vision.memory.preferences
        config = Config(
            words=dict(words),
            vocabulary=tuple(words),
            camera=schema.CameraSection(rate=1.0 / FRAME_PERIOD),
            stopping=schema.StoppingSection(unchecked=policy == "hold"),
            call=schema.CallSection(policy=policy),
            journal=schema.JournalSection(folder=str(folder)),
            pictures=schema.PicturesSection(keep=pictures),
        )
        self.journal = Journal(folder)
        self.writer = Writer(self.journal)
        listed = build(list(words), words, {})
        self.link = Link(LinkSettings(_NOWHERE), listed, now, openers={MAIN: opener})
        self._vision = vision
        opened = Resources(self.link, vision, self.journal, self.writer, ServedFiles(folder), {})
        if settings is not None:
            ready = replace(ready, settings=settings)
        supervisor = compose(config, opened, ready, [], state_machine=CountedCalls)
        self._daemon = supervisor.daemon
        self.calls = cast(CountedCalls, supervisor.calls)

    def turn(self) -> None:
        """Runs one turn of the daemon's loop, and then writes what it wants stored to disk."""
        self._daemon.turn()
        self.writer.drain()

    def close(self) -> None:
        """Closes vision, link and writer."""
        self._vision.close()
        self.link.close()
        self.writer.close()


class Rover(Companion):
    """A companion with a simulated vision process; `shows` is the number of the thing ahead."""

    def __init__(self, folder: Path, opener: Callable[[], Transport], *, pictures: int = 0) -> None:
        self._child = LoopbackVision(make_engine)
        self.vision = CountedVision(lambda: self._child, Config(), None, VISION)
        self.vision.asked = []
        make_ready(self.vision, self._child)
        super().__init__(folder, opener, self.vision, pictures=pictures)
        self.shows = 0
        self._frame_id = 0
        self._frame_at = time.monotonic()
        self._delivered_at: float | None = None

    def turn(self) -> None:
        """Lets vision judge what is ahead, then runs one turn of the daemon."""
        now = time.monotonic()
        self._child.work()
        if now >= self._frame_at:
            self._frame_at = max(self._frame_at + FRAME_PERIOD, now)
            self._frame_id += 1
            self._delivered_at = now
            self._child.judge(Frame(self._frame_id, now, picture(self.shows)))
        self._child.live(CameraStatus(CameraState.DELIVERING), self._delivered_at)
        super().turn()

    @property
    def clear(self) -> bool:
        """Whether no call is open, no thing is accepted and frames are OK: the next thing makes a call."""
        reason_filter = self.calls.reason_filter
        return self.calls.current_id == 0 and not reason_filter.things and reason_filter.ok_run > 0


def make_ready(vision: VisionClient, child: LoopbackVision) -> None:
    """Let a simulated vision process load."""
    while vision.ready is None:
        vision.poll(time.monotonic())
        child.work()


def make_engine(memory: Memory | None) -> AnyTraverse:
    perceiver = NumberPerceiver()
    known = memory or first_memory(perceiver.model_id, Preferences.parse(f"{GRASS}: 1"))
    return AnyTraverse(perceiver, Settings(region=_ROI), known)
