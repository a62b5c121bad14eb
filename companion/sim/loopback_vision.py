"""Stands in for the vision process in tests and benches: real messages, no process, the caller's time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from msgspec.structs import replace

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.memory import Memory
from companion.cameras.newest import CameraStatus
from companion.vision.codec import Splitter, decode_trusted, encode
from companion.vision.memory_copy import parts, update_from
from companion.vision.messages import Alive, Model, Ready, Report, Scenes, Start, Tune
from companion.vision.worker import Worker, weak_in_use

_MAX_REQUESTS = 256


class LoopbackVision:
    """A `Child` that carries out its requests when `work` is called, and does nothing while it is `hung`."""

    idle = True

    def __init__(self, engine: Callable[[Memory | None], AnyTraverse], step: float = 0.02) -> None:
        """engine: makes an engine from a memory (None: none was stored). step: s that a step takes."""
        self._make = engine
        self._step = step
        self.frame_s = 0.0
        """Seconds that are reported of each frame, where it did not take longer."""
        self._splitter = Splitter()
        self._requests: list[bytes] = []
        self._reports: list[bytes] = []
        self._begun: Start | None = None
        self._worker: Worker | None = None
        self._tuned = False
        self.hung = False
        self.death = ""
        self.requests: deque[object] = deque(maxlen=_MAX_REQUESTS)
        """The newest requests, oldest first."""

    def fileno(self) -> int | None:
        return None

    def send(self, message: bytes) -> bool:
        self._requests += self._splitter.feed(message)
        return True

    def receive(self) -> list[bytes]:
        taken, self._reports = self._reports, []
        return taken

    def ended(self) -> str:
        return self.death

    def close(self) -> None:
        self.death = self.death or "closed"

    def work(self) -> None:
        """Carries out the requests that wait."""
        while self._requests and not self.hung and not self.death:
            request = decode_trusted(self._requests.pop(0))
            self.requests.append(request)
            self._tuned = self._tuned or isinstance(request, Tune)
            if isinstance(request, Scenes) and self._begun is not None:
                request = self._begun.joined(request.entries)
            if isinstance(request, Start):
                self._begun = request
                if not request.more:
                    self._start(request)
            elif self._worker is not None:
                for report in self._worker.handle(request):
                    self.report(report)

    def judge(self, frame: Frame) -> None:
        """Judges a frame and reports it, as if the camera had delivered it; before the first `Tune` none."""
        if self._worker is not None and self._tuned and not self.hung and not self.death:
            judged = self._worker.judge(frame)
            self.report(replace(judged, duration=max(judged.duration, self.frame_s)))
            if (ground := self._worker.remember_ground(judged.assessment)) is not None:
                self.report(ground)
            if (planned := self._worker.plan(judged.assessment)) is not None:
                self.report(planned)

    def live(self, camera: CameraStatus, delivered_at: float | None) -> None:
        """Reports that the process is alive, with the camera's status."""
        if not self.hung and not self.death:
            self.report(Alive(camera, delivered_at))

    def report(self, report: Report) -> None:
        """Sends any report to the supervisor."""
        for part in parts(report):
            self._reports += Splitter().feed(encode(part))

    def _start(self, start: Start) -> None:
        engine, revision = self._make(start.memory), start.revision + 1
        self._worker = Worker(engine, revision)
        memory = engine.memory
        update = update_from(start.memory, memory, revision, start.revision, weak_in_use(engine, memory))
        self.report(Ready(Model.of(engine.perceiver), engine.settings, update, (), self._step))
