"""The thread that sees: it judges the newest frame and applies answers in between.

It alone touches AnyTraverse."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from anytraverse.answers import AnswerOutcome, Changes
from anytraverse.assessment import Assessment, Observation
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import Place
from anytraverse.judging import Settings
from anytraverse.memory import Memory

log = logging.getLogger(__name__)

MAX_JOBS = 8
MAX_RESULTS = 64
_PATIENCE = 0.05


class FrameSource(Protocol):
    """Where the newest frame comes from."""

    def take(self, timeout: float) -> Frame | None:
        """The newest frame not yet taken, or None after `timeout` seconds."""


@dataclass(frozen=True)
class Judged:
    """A new frame was judged. memory: as it is after the frame; at: monotonic seconds when it was done."""

    assessment: Assessment
    memory: Memory
    at: float


@dataclass(frozen=True)
class Applied:
    """An answer was applied, or refused with `error`; then nothing has changed."""

    token: object
    outcome: AnswerOutcome | None
    error: AnyTraverseError | None
    memory: Memory


Result = Judged | Applied


class Eyes:
    """Owns the engine in a thread of its own, so that a hung perceiver stops nothing but itself.

    Results are read by `results()`; `fileno()` turns readable when there are some.
    """

    def __init__(
        self,
        engine: AnyTraverse,
        camera: FrameSource,
        period: float,
    ) -> None:
        self._engine = engine
        self._camera = camera
        self._period = period
        self.place: Callable[[], Place] = Place
        """Asked for what goes with a remembered scene."""
        self._jobs: queue.Queue[Callable[[], Result | None]] = queue.Queue(MAX_JOBS)
        self._results: deque[Result] = deque(maxlen=MAX_RESULTS)
        self._wake_reader, self._wake_writer = os.pipe()
        os.set_blocking(self._wake_reader, False)
        os.set_blocking(self._wake_writer, False)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="eyes", daemon=True)
        self.alive_at = time.monotonic()

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def fileno(self) -> int:
        """Readable when results wait."""
        return self._wake_reader

    def results(self) -> list[Result]:
        """What has come since the last call, oldest first."""
        with contextlib.suppress(BlockingIOError):
            os.read(self._wake_reader, 4096)
        taken: list[Result] = []
        while self._results:
            taken.append(self._results.popleft())
        return taken

    def answer(
        self, token: object, changes: Changes, *, call: Observation | None, call_id: int, go: bool
    ) -> bool:
        """Have an answer applied; an `Applied` with `token` follows. False when too many wait."""

        def job() -> Result:
            try:
                outcome = self._engine.answer(
                    changes, time.monotonic(), call=call, call_id=call_id, go=go, place=self.place()
                )
                return Applied(token, outcome, None, self._engine.memory)
            except AnyTraverseError as error:
                return Applied(token, None, error, self._engine.memory)
            except Exception:
                log.exception("an answer could not be applied")
                failure = AnyTraverseError("the perceiver failed on it: see the companion's log")
                return Applied(token, None, failure, self._engine.memory)

        return self._submit(job)

    def look_at(self, token: object, frame: Frame) -> bool:
        """Judge a stored frame: the one of a call that was open at a restart. False when too many wait."""

        def job() -> Result:
            observation = self._engine.observe(frame)
            outcome = self._engine.answer(Changes(), time.monotonic(), call=observation)
            return Applied(token, outcome, None, self._engine.memory)

        return self._submit(job)

    def retune(self, settings: Settings) -> bool:
        """Judge by other settings from the next frame on. False when too many wait."""

        def job() -> None:
            self._engine.settings = settings

        return self._submit(job)

    def stop(self, timeout: float = 2.0) -> None:
        """End the thread; a hung perceiver is left behind."""
        self._stop.set()
        self._thread.join(timeout)

    def _submit(self, job: Callable[[], Result | None]) -> bool:
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            return False
        return True

    def _publish(self, result: Result) -> None:
        self._results.append(result)
        with contextlib.suppress(BlockingIOError):
            os.write(self._wake_writer, b".")

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            self.alive_at = time.monotonic()
            self._do_jobs()
            if self.alive_at < due:
                self._stop.wait(min(_PATIENCE, due - self.alive_at))
                continue
            frame = self._camera.take(timeout=_PATIENCE)
            if frame is not None:
                due = max(due + self._period, time.monotonic() - self._period)
                self._publish(self._judge(frame))

    def _do_jobs(self) -> None:
        for _ in range(MAX_JOBS):
            try:
                job = self._jobs.get_nowait()
            except queue.Empty:
                return
            try:
                result = job()
                if result is not None:
                    self._publish(result)
            except Exception:
                log.exception("a stored frame could not be judged")

    def _judge(self, frame: Frame) -> Judged:
        try:
            assessment = self._engine.step(frame, time.monotonic(), self.place())
        except Exception:
            log.exception("frame %d could not be judged", frame.id)
            assessment = self._engine.fault(frame, time.monotonic(), "the perceiver failed")
        return Judged(assessment, self._engine.memory, time.monotonic())
