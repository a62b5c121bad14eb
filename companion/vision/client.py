"""The supervisor's side of the vision process: it starts, watches and restarts it, and speaks with it.

Nothing here waits. What the process says is checked before it is believed.
"""

from __future__ import annotations

import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from anytraverse.answers import AnswerOutcome, Changes
from anytraverse.assessment import Assessment
from anytraverse.errors import AnyTraverseError
from anytraverse.history import Entry, History, Place
from anytraverse.judging import Settings
from anytraverse.memory import Memory
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.tasks import Restarts
from companion.vision.checks import BadReportError, Expected, checked
from companion.vision.child import Child
from companion.vision.codec import CodecError, decode, encode
from companion.vision.messages import (
    Alive,
    Answer,
    Done,
    Draw,
    Drawn,
    Failed,
    Logged,
    Looked,
    MemoryUpdate,
    Ready,
    Request,
    Restore,
    Scenes,
    Situation,
    Start,
    Tune,
    updated,
)
from companion.wire.ids import State

log = logging.getLogger(__name__)

MAX_JOBS = 8
"""Answers that may wait for their outcome."""
MAX_DRAWINGS = 16
KEPT = 2
"""Frames of the open call and the hold: a restarted process gets back those of which there is a PNG."""
SILENT_AFTER = 2.0
"""Seconds without a sign of life, beside those of a step, after which no job is taken: whoever asks must not
wait in vain."""
_STALLED = 1.0
"""Seconds between two polls after which the supervisor itself stood still: no silence counts then."""
_SITUATION_EVERY = 0.2
_SCENES = 64
"""Remembered scenes in one message: one is encoded in about 0.1 ms."""
_DEATHS = 3
_OFTEN = 600.0
"""Three deaths in this many seconds: the process is not to be relied on."""


class VisionLostError(AnyTraverseError):
    """The vision process died before it said what became of a request: nothing of it remains."""


@dataclass(frozen=True)
class Judged:
    """A new frame was judged.

    memory: as it is after the frame; changed: by it. at: monotonic seconds when it was done. took: seconds.
    sectors: drivable share of each image column over the ROI's rows, None where nothing is known.
    """

    assessment: Assessment
    memory: Memory
    at: float
    took: float = 0.0
    sectors: tuple[float | None, ...] = ()
    changed: bool = False


@dataclass(frozen=True)
class Applied:
    """An answer was applied, or refused with `error`; then nothing has changed.

    token: the asker's; None: a frame was given back to a new process.
    """

    token: object
    outcome: AnswerOutcome | None
    error: AnyTraverseError | None
    memory: Memory


Result = Judged | Applied | Drawn


class Vision:
    """One process at a time. `poll` is called in every turn of the main loop.

    memory: the last accepted copy; a new process starts from it. weak: words in use that it finds badly.
    camera, delivered_at: as the process told them last. trouble: why nothing is judged, "" while all is well.
    """

    def __init__(
        self,
        launch: Callable[[], Child],
        config: Config,
        memory: Memory | None,
        restarts: Restarts,
        *,
        first_frame: int = 1,
    ) -> None:
        """memory: as the journal has it. launch raises OSError. restarts: limits, from the table of tasks."""
        self._launch = launch
        self._config = config
        self._restarts = restarts
        self._memory = memory
        self._revision = 0
        self._expected = Expected(first_frame - 1)
        self._child: Child | None = None
        self._again_at = float("-inf")
        self._started_at = self._heard_at = self._polled_at = time.monotonic()
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._failures = 0
        self._settings: Settings | None = None
        self._numbers = 0
        self._scenes: deque[Entry] = deque()
        """What a process that was started has still to get."""
        self._asked: OrderedDict[int, object] = OrderedDict()
        self._drawing: dict[int, int] = {}
        """Picture -> the frame that is kept for it, 0: none."""
        self._restoring: dict[int, int] = {}
        """Request -> the frame that it gives back."""
        self._suspects = set[int]()
        """Frames that the last process died over; one that two in a row died over is not given back."""
        self._frames: OrderedDict[int, bytes] = OrderedDict()
        self._situation_at = float("-inf")
        self._running = self._full = False
        self.ready: Ready | None = None
        self.failed = ""
        self.weak: tuple[str, ...] = ()
        self.camera = CameraStatus()
        self.delivered_at: float | None = None
        self.trouble = "vision starting"
        self.restarted = 0

    @property
    def memory(self) -> Memory:
        """The last accepted copy. Only once it was ready."""
        assert self._memory is not None
        return self._memory

    @property
    def alive_at(self) -> float:
        """Monotonic seconds of its last sign of life."""
        return self._heard_at if self._running else float("-inf")

    @property
    def answers_within(self) -> float:
        """Seconds in which as many answers as may wait have their outcome, or the process counts as lost."""
        return (MAX_JOBS + 1) * self._limit()

    @property
    def unreliable(self) -> bool:
        """Whether it died three times within ten minutes."""
        return len(self._deaths) == _DEATHS and self._polled_at - self._deaths[0] <= _OFTEN

    def fileno(self) -> int | None:
        """For select; None while there is no process. Ask each time: a restart changes it."""
        return None if self._child is None else self._child.fileno()

    def poll(self, now: float) -> list[Result]:
        """What has come since the last call, oldest first; of several judgements only the newest."""
        if now - self._polled_at > _STALLED:
            self._heard_at = self._started_at = now
        self._polled_at = now
        if self._child is None:
            if now >= self._again_at and not self.failed:
                self._start(now)
            return []
        if self._scenes and self._child.idle:
            self._send(Scenes(self._next_scenes()))
        results: list[Result] = []
        try:
            ended = self._child.ended()
            for packed in self._child.receive():
                report = checked(decode(packed), self._expected, time.monotonic())
                results += self._hear(report, now)
        except (CodecError, BadReportError) as error:
            return _newest(results) + self._lose(f"sent nonsense ({error})", "vision sent nonsense", now)
        if self._full:
            return _newest(results) + self._lose("does not take what it is sent", "vision hangs", now)
        if self.failed and self.ready is not None:
            what = f"cannot be loaded ({self.failed})"
            return _newest(results) + self._lose(what, "vision cannot be loaded", now)
        if ended:
            return _newest(results) + self._lose(f"ended: {ended}", f"vision died ({ended})", now)
        silent, limit = now - max(self._heard_at, self._started_at), self._limit()
        if silent > limit:
            return _newest(results) + self._lose(
                f"gave no sign of life for {silent:.1f} s", "vision hangs", now
            )
        return _newest(results)

    def answer(
        self,
        token: object,
        changes: Changes,
        *,
        frame_id: int = 0,
        call_id: int = 0,
        go: bool = False,
        place: Place | None = None,
    ) -> bool:
        """Have an answer applied; an `Applied` with `token` follows.

        frame_id: of the call's or hold's frame, 0: words alone. place: the call's, by default the vehicle's.
        False when too many wait, or the process hangs or is not ready.
        """
        return self._ask(token, lambda number: Answer(number, changes, frame_id, call_id, go, place))

    def restore(self, token: object, frame_id: int, png: bytes) -> bool:
        """Have the frame of a call that was open at a restart judged; an `Applied` follows.

        False as for `answer`.
        """
        self._remember_frame(frame_id, png)
        return self._ask(token, lambda number: self._restore(number, frame_id, png))

    def tune(self, settings: Settings) -> bool:
        """Judge by these settings from the next frame on; the first time, begin to. False as for `answer`."""
        if not self._takes_jobs():
            return False
        if not self._send(Tune(settings)):
            return False
        self._settings = settings
        return True

    def draw(self, frame_id: int, title: str, state: State, *, keep: bool = False) -> bool:
        """Have a frame that was judged lately drawn; a `Drawn` follows. False: not asked.

        keep: it is a call's or hold's, which can be answered and tapped in from now on.
        """
        most = MAX_DRAWINGS + (KEPT if keep else 0)
        if not self._running or len(self._drawing) >= most:
            log.warning("no picture of %s: the vision process does not draw now", title)
            return False
        self._numbers += 1
        if not self._send(Draw(self._numbers, frame_id, title, state, keep)):
            return False
        self._drawing[self._numbers] = frame_id if keep else 0
        return True

    def situation(self, place: Place, now: float, *, moving: bool) -> None:
        """Tell where the vehicle is and whether it moves, some five times a second."""
        ready = self._running and self._child is not None and self._child.idle
        if ready and now - self._situation_at >= _SITUATION_EVERY:
            self._situation_at = now
            self._send(Situation(place, moving))

    def holds_frame(self, frame_id: int) -> bool:
        """Whether this frame can be answered, or was asked to be kept for that."""
        return frame_id in self._frames or frame_id in self._drawing.values()

    def close(self) -> None:
        """End the process; the camera is free when this returns, unless a driver keeps it."""
        if self._child is not None:
            self._child.close()
            self._child = None
        self._running = self._full = False

    def _start(self, now: float) -> None:
        try:
            self._child = self._launch()
        except OSError as error:
            self._child = None
            self._lose(f"cannot be started ({error})", "vision cannot be started", now)
            return
        self._started_at = self._heard_at = now
        memory, first = self._memory, self._expected.last_frame + 1
        if memory is not None:
            self._scenes = deque(memory.history)
            memory = replace(memory, history=History(self._next_scenes(), memory.history.limit))
        self._send(Start(self._config, memory, self._revision, first, len(self._scenes)))

    def _next_scenes(self) -> tuple[Entry, ...]:
        return tuple(self._scenes.popleft() for _ in range(min(_SCENES, len(self._scenes))))

    def _limit(self) -> float:
        """Seconds of silence after which the process counts as hung."""
        if not self._running or self.ready is None:
            return self._restarts.loading
        return self._restarts.silent_for + 4.0 * self.ready.step

    def _hear(self, report: object, now: float) -> list[Result]:
        self._heard_at = now
        if isinstance(report, (Looked, Done, Drawn)) and not self._running:
            raise BadReportError(f"{type(report).__name__} before it was ready")
        match report:
            case Logged(level, name, text):
                logging.getLogger(name).log(level, "%s", text)
            case Alive(camera, delivered_at):
                self.camera, self.delivered_at = camera, delivered_at
            case Failed(text):
                self.failed = text
            case Ready():
                self._is_ready(report, now)
            case Looked():
                if report.update is not None:
                    self._take(report.update)
                if report.revision != self._revision:
                    raise BadReportError(f"a frame under revision {report.revision}, not {self._revision}")
                return [
                    Judged(
                        report.assessment,
                        self.memory,
                        report.at,
                        report.took,
                        report.sectors,
                        report.update is not None,
                    )
                ]
            case Done():
                if report.number not in self._asked:
                    raise BadReportError(f"an outcome of request {report.number}, which nobody made")
                if report.update is not None:
                    self._take(report.update)
                frame_id = self._restoring.pop(report.number, None)
                if report.error and frame_id is not None:
                    self._frames.pop(frame_id, None)
                error = AnyTraverseError(report.error) if report.error else None
                return [Applied(self._asked.pop(report.number), report.outcome, error, self.memory)]
            case Drawn():
                if report.number not in self._drawing:
                    raise BadReportError(f"picture {report.number}, which nobody asked for")
                del self._drawing[report.number]
                if report.kept:
                    self._remember_frame(report.frame_id, report.png)
                return [report]
        return []

    def _take(self, update: MemoryUpdate) -> None:
        """The next copy of the memory, where it follows the last one."""
        if update.base != self._revision or update.revision != self._revision + 1:
            raise BadReportError(f"memory {update.revision} on {update.base}, not on {self._revision}")
        self._memory = updated(self._memory, update)
        self._revision = update.revision
        self.weak = update.weak

    def _is_ready(self, ready: Ready, now: float) -> None:
        first = self.ready
        if first is not None and ready.model.id != first.model.id:
            self.failed = f"it is {ready.model.id} now, not {first.model.id}: restart the companion"
            return
        self._take(ready.update)
        self._running, self._started_at, self.trouble = True, now, ""
        if first is None:
            self.ready = ready
            self._settings = ready.settings
            return
        log.info("the vision process is back")
        assert self._settings is not None
        self._send(Tune(self._settings))
        for frame_id, png in self._frames.items():
            self._numbers += 1
            self._asked[self._numbers] = None
            self._send(self._restore(self._numbers, frame_id, png))

    def _lose(self, what: str, short: str, now: float) -> list[Result]:
        """The process is lost: killed, and started again after a while. Whoever waits for it is told."""
        if self.failed and self.ready is None:
            self.close()
            return []
        if self._running and now - self._started_at >= self._restarts.longest:
            self._failures = 0
        wait = 0.0 if self._failures == 0 else self._restarts.first * 2.0 ** (self._failures - 1)
        wait = min(wait, self._restarts.longest)
        log.error("the vision process %s; it is started again in %.0f s", what, wait)
        self.close()
        self.failed = ""
        self._failures += 1
        self._deaths.append(now)
        self._again_at = now + wait
        self.trouble = short
        self.restarted += 1
        self.camera = replace(self.camera, state=CameraState.CONNECTING, reason=what)
        self.delivered_at = None
        self._drawing.clear()
        given = set(self._restoring.values())
        self._restoring.clear()
        spoilt, self._suspects = given & self._suspects, given
        self._frames = OrderedDict(
            (number, png) for number, png in self._frames.items() if png and number not in spoilt
        )
        error = VisionLostError("vision restarted: send it again")
        asked = [token for token in self._asked.values() if token is not None]
        self._asked.clear()
        return (
            [Applied(token, None, error, self.memory) for token in asked] if self._memory is not None else []
        )

    def _takes_jobs(self) -> bool:
        if not self._running or self.ready is None:
            return False
        return self._polled_at - self._heard_at <= SILENT_AFTER + self.ready.step

    def _ask(self, token: object, request: Callable[[int], Request]) -> bool:
        if not self._takes_jobs() or len(self._asked) >= MAX_JOBS:
            return False
        self._numbers += 1
        if not self._send(request(self._numbers)):
            return False
        self._asked[self._numbers] = token
        return True

    def _send(self, request: Request) -> bool:
        if self._child is None:
            return False
        try:
            if self._child.send(encode(request)):
                return True
        except CodecError as error:
            log.error("not sent to the vision process: %s", error)
        self._full = True  # with the next poll it is lost
        return False

    def _restore(self, number: int, frame_id: int, png: bytes) -> Restore:
        self._restoring[number] = frame_id
        return Restore(number, frame_id, png)

    def _remember_frame(self, frame_id: int, png: bytes) -> None:
        self._frames[frame_id] = png
        self._frames.move_to_end(frame_id)
        while len(self._frames) > KEPT:
            self._frames.popitem(last=False)


def _newest(results: list[Result]) -> list[Result]:
    """Without judgements that a newer one replaces; those that changed the memory stay."""
    last = next((one for one in reversed(results) if isinstance(one, Judged)), None)
    return [one for one in results if not isinstance(one, Judged) or one is last or one.changed]
