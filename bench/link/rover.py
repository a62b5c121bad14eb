"""The rover's side: the daemon as it ships, with its journal; only camera and perceiver are played."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, cast

from anytraverse.answers import AnswerOutcome
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.pace import Pace
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from bench.link.plates import GRASS, Plates, SteppedEyes, picture
from companion.album import Album
from companion.calls.decisions import Decision
from companion.calls.machine import OperatorCalls
from companion.calls.numbers import Numbers
from companion.cameras.newest import CameraState, CameraStatus, CameraThread
from companion.config import Config
from companion.configured import kept_values
from companion.conversation import Conversation
from companion.daemon import Daemon
from companion.eyes import Eyes
from companion.files.calls import CallFiles
from companion.journal import Journal
from companion.keeper import Keeper
from companion.link.link import Link
from companion.link.settings import MAIN, LinkSettings
from companion.link.transport import Transport
from companion.model import Model
from companion.overrides import Overrides
from companion.refusal import HoldJudge
from companion.settings_desk import SettingsDesk
from companion.shadow_book import ShadowBook
from companion.tasks import Liveness, tasks
from companion.wire.ids import Motion, Policy, Result
from companion.wire.parameters import build
from companion.writer import Writer

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
    """The daemon's own; `applied` keeps every answer that reached it."""

    def __init__(self, numbers: Numbers, now: float) -> None:
        super().__init__(numbers, now)
        self.applied: list[Applied] = []

    def answered(
        self,
        target: int,
        motion: Motion,
        changed: bool,
        outcome: AnswerOutcome | None,
        now: float,
        *,
        go_at: float | None = None,
    ) -> tuple[Result, list[Decision]]:
        """As ever, and counted."""
        result, decisions = super().answered(target, motion, changed, outcome, now, go_at=go_at)
        self.applied.append(Applied(now, target, motion, result))
        return result, decisions


class PlayedCamera:
    """As far as the daemon looks at a `CameraThread`."""

    state = CameraState.DELIVERING
    status = CameraStatus(CameraState.DELIVERING)

    def __init__(self) -> None:
        self.delivered_at: float | None = None

    def take(self, timeout: float) -> Frame | None:  # noqa: ARG002
        """Stepped eyes are handed their frames."""
        return None


class Companion:
    """The daemon, put together as `companion run` does; policy report. Call `turn` some 50 times a second."""

    def __init__(
        self,
        folder: Path,
        opener: Callable[[], Transport],
        engine: AnyTraverse,
        eyes: Eyes,
        camera: PlayedCamera,
    ) -> None:
        now = time.monotonic()
        words, judging, model = engine.memory.preferences, engine.settings, Model.of(engine.perceiver)
        listed = build(list(words), words, {})
        self.journal = Journal(folder)
        self.link = Link(LinkSettings(_NOWHERE), listed, now, openers={MAIN: opener})
        self.calls = CountedCalls(Numbers(policy=Policy.REPORT, judging=judging), now)
        self._seeing = eyes
        conversation = Conversation(self.calls, eyes, words)
        album, files = Album(folder / "pictures", 0), CallFiles(folder / "calls")
        self.writer = Writer(self.journal)
        keeper = Keeper(self.journal, self.writer, album, files, folder / "status.json", lambda: _ROI)
        book, _ = ShadowBook.restored(None, self.calls.shadow, model.id, now, time.time())
        judge = HoldJudge(Config(), Pace(0.02, FRAME_PERIOD, judging.freshness))
        desk = SettingsDesk(
            listed,
            self.link,
            eyes,
            self.calls,
            conversation,
            judge.refuses,
            Overrides(kept_values(Config(), judging), model.id),
            book=book,
        )
        desk.start(now)
        self._daemon = Daemon(
            self.link,
            cast(CameraThread, camera),
            eyes,
            self.calls,
            keeper,
            conversation,
            desk,
            Liveness(tasks(self.calls.numbers), now),
            model,
        )

    def turn(self) -> None:
        """One round of the daemon's loop; what it wants kept is on disk before the next."""
        self._daemon.turn()
        self.writer.drain()

    def close(self) -> None:
        """Give everything back."""
        self._seeing.stop()
        self.link.close()
        self.writer.close()


class Rover(Companion):
    """With eyes that are stepped; `shows` is the number of what is ahead."""

    def __init__(self, folder: Path, opener: Callable[[], Transport]) -> None:
        perceiver = Plates()
        memory = first_memory(perceiver.model_id, Preferences.parse(f"{GRASS}: 1"))
        self._camera = PlayedCamera()
        self.eyes = SteppedEyes(
            AnyTraverse(perceiver, Settings(region=_ROI), memory), self._camera, FRAME_PERIOD
        )
        super().__init__(folder, opener, self.eyes.engine, self.eyes, self._camera)
        self.shows = 0
        self._frame_id = 0
        self._frame_at = time.monotonic()

    def turn(self) -> None:
        """After a look at what is ahead."""
        now = time.monotonic()
        frame = None
        if now >= self._frame_at:
            self._frame_at = max(self._frame_at + FRAME_PERIOD, now)
            self._frame_id += 1
            frame = Frame(self._frame_id, now, picture(self.shows))
            self._camera.delivered_at = now
        self.eyes.look(frame, now)
        super().turn()

    @property
    def clear(self) -> bool:
        """Whether nothing is asked, nothing accepted and all is well: the next thing makes a call."""
        sight = self.calls.sight
        return self.calls.current_id == 0 and sight.acceptance is None and sight.ok_run > 0
