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
from dataclasses import dataclass, replace
from typing import Protocol

from anytraverse.answers import AnswerOutcome, Changes
from anytraverse.assessment import Assessment, Finding, Observation, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import Place
from anytraverse.judging import Settings, check_age
from anytraverse.memory import Memory
from companion.frozen import FrozenPicture

log = logging.getLogger(__name__)

MAX_JOBS = 8
MAX_RESULTS = 64
_PATIENCE = 0.05
_LOGGED_AGAIN = 10.0
HUNG_AFTER = 2.0
"""Seconds without a sign of life after which no job is taken: whoever asks must not wait in vain."""


class FrameSource(Protocol):
    """Where the newest frame comes from."""

    def take(self, timeout: float) -> Frame | None:
        """The newest frame not yet taken, or None after `timeout` seconds."""


@dataclass(frozen=True)
class Judged:
    """A new frame was judged.

    memory: as it is after the frame. at: monotonic seconds when it was done. took: seconds.
    """

    assessment: Assessment
    memory: Memory
    at: float
    took: float = 0.0


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
        self.moving: Callable[[], bool] = lambda: False
        """Asked whether the vehicle moves, so that no picture can be the same as the one before."""
        self._frozen = FrozenPicture()
        self._jobs: queue.Queue[Callable[[], Result | None]] = queue.Queue(MAX_JOBS)
        self._results: deque[Result] = deque()
        self._wake_reader, self._wake_writer = os.pipe()
        os.set_blocking(self._wake_reader, False)
        os.set_blocking(self._wake_writer, False)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="eyes", daemon=True)
        self._logged_at = float("-inf")
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
        self,
        token: object,
        changes: Changes,
        *,
        call: Observation | None,
        call_id: int,
        go: bool,
        place: Place | None = None,
    ) -> bool:
        """Have an answer applied; an `Applied` with `token` follows. place: the call's, by default ours now.

        False when too many wait, or the thread hangs.
        """

        def job() -> Result:
            try:
                outcome = self._engine.answer(
                    changes, time.monotonic(), call=call, call_id=call_id, go=go, place=place or self.place()
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
        """Judge a stored frame, the one of a call that was open at a restart; an `Applied` follows.

        False as for `answer`.
        """

        def job() -> Result:
            try:
                observation = self._engine.observe(frame)
                outcome = self._engine.answer(Changes(), time.monotonic(), call=observation)
            except Exception as error:
                log.exception("a stored frame could not be judged")
                return Applied(token, None, AnyTraverseError(str(error)), self._engine.memory)
            return Applied(token, outcome, None, self._engine.memory)

        return self._submit(job)

    def retune(self, settings: Settings) -> bool:
        """Judge by other settings from the next frame on. False as for `answer`."""

        def job() -> None:
            self._engine.settings = settings

        return self._submit(job)

    def stop(self, timeout: float = 2.0) -> None:
        """End the thread; a hung perceiver is left behind."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(timeout)
        if self._thread.is_alive():
            log.warning("the eyes hang and are left behind")
        elif self._wake_reader >= 0:
            os.close(self._wake_reader)
            os.close(self._wake_writer)
            self._wake_reader = self._wake_writer = -1

    def _submit(self, job: Callable[[], Result | None]) -> bool:
        if time.monotonic() - self.alive_at > HUNG_AFTER:
            return False
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            return False
        return True

    def _publish(self, result: Result) -> None:
        self._results.append(result)
        if len(self._results) > MAX_RESULTS:
            self._forget_oldest_frame()
        with contextlib.suppress(BlockingIOError):
            os.write(self._wake_writer, b".")

    def _forget_oldest_frame(self) -> None:
        """Nobody reads: frames are worth nothing when old, but whoever answered waits for what came of it."""
        for result in list(self._results):
            if isinstance(result, Judged):
                with contextlib.suppress(ValueError):  # read at this moment
                    self._results.remove(result)
                return

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            self.alive_at = time.monotonic()
            self._do_jobs()
            frame = self._camera.take(timeout=_PATIENCE)
            now = time.monotonic()
            # Judged as it comes or not at all: a frame that waited for its turn would be older than need be.
            if frame is not None and now >= due - self._period / 2:
                due = max(due + self._period, now - self._period)
                self._publish(self._judge(frame))

    def _do_jobs(self) -> None:
        for _ in range(MAX_JOBS):
            try:
                job = self._jobs.get_nowait()
            except queue.Empty:
                return
            try:
                result = job()
            except Exception:
                log.exception("a job of the eyes failed")
                continue
            if result is not None:
                self._publish(result)

    def _judge(self, frame: Frame) -> Judged:
        started = time.monotonic()
        try:
            assessment = self._engine.step(frame, started, self.place())
        except Exception:
            self._log_failure(frame)
            assessment = self._engine.fault(frame, time.monotonic(), "the perceiver failed")
        now = time.monotonic()
        still = self._frozen.seconds(frame.image, started, moving=self.moving())
        dated = _dated(assessment, now, self._engine.settings.freshness, still)
        return Judged(dated, self._engine.memory, now, now - started)

    def _log_failure(self, frame: Frame) -> None:
        """Once in a while: it may happen with every frame."""
        now = time.monotonic()
        if now - self._logged_at >= _LOGGED_AGAIN:
            self._logged_at = now
            log.exception("frame %d could not be judged", frame.id)


def _dated(seen: Assessment, now: float, freshness: float, still: float) -> Assessment:
    """With its age after judging: what took too long to judge is no fresh view, however young it was.

    Nor is a picture that has not changed for longer than T while the vehicle moved, `still` seconds.
    """
    age = now - seen.frame.captured_at
    late = [] if Reason.FAULT in seen.reasons else check_age(age, freshness)
    if still > freshness:
        late.append(Finding.fault("camera frozen"))
    return replace(seen, age=age, findings=(*seen.findings, *late))
