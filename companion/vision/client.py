"""Starts, watches and restarts the vision process, sends it requests and takes its reports.

Nothing here blocks. Each report is checked before it is used.
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
"""Answers that may wait for their outcome at once."""
MAX_DRAWINGS = 16
KEPT = 2
"""Stored frames, of the open call and the hold. A restarted process gets those that have come as PNG."""
SILENT_AFTER = 2.0
"""Seconds without a sign of life, plus those of one step, after which requests are refused: their sender
would wait in vain."""
_STALLED = 1.0
"""Seconds between two polls after which the supervisor itself was stalled: the silence so far is its own."""
_SITUATION_EVERY = 0.2
_SCENES = 64
"""Remembered scenes in one message, at most. Encoding one takes about 0.1 ms of the main loop."""
_DEATHS = 3
_OFTEN = 600.0
"""Seconds. After `_DEATHS` deaths within this time the process counts as unreliable."""


class VisionLostError(AnyTraverseError):
    """The vision process died before it reported a request's outcome; the request had no effect."""


@dataclass(frozen=True)
class Judged:
    """Reports a new frame's assessment.

    memory: as it is after the frame. changed: whether the frame changed the memory. at: monotonic seconds
    when judging ended. took: seconds of judging. sectors: drivable share of each image column over the ROI's
    rows, None where nothing is known.
    """

    assessment: Assessment
    memory: Memory
    at: float
    took: float = 0.0
    sectors: tuple[float | None, ...] = ()
    changed: bool = False


@dataclass(frozen=True)
class Applied:
    """Reports that an answer was applied, or refused with `error`; then nothing has changed.

    token: what the caller of `answer` passed. None: a stored frame was given to a new process.
    """

    token: object
    outcome: AnswerOutcome | None
    error: AnyTraverseError | None
    memory: Memory


Result = Judged | Applied | Drawn


class Vision:
    """Owns the vision process. The main loop calls `poll` in every turn.

    memory: the newest accepted copy; a restarted process begins with it. weak: words in use that the
    perceiver recognises badly. camera, delivered_at: as last reported. failed: why the perceiver cannot be
    loaded, "" otherwise. trouble: why nothing is judged now, "" while all is well. restarted: how often.
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
        """launch: starts a process or raises OSError. memory: from the journal. restarts: time limits."""
        self._launch = launch
        self._config = config
        self._restarts = restarts
        self._memory = memory
        self._revision = 0
        self._expected = Expected(first_frame - 1)
        self._child: Child | None = None
        self._restart_at = float("-inf")
        self._started_at = self._reported_at = self._polled_at = time.monotonic()
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._failures = 0
        self._settings: Settings | None = None
        self._numbers = 0
        self._scenes: deque[Entry] = deque()
        """Scenes that a restarted process must still get."""
        self._unanswered: OrderedDict[int, object] = OrderedDict()
        self._drawing: dict[int, int] = {}
        """Number of the request -> id of the frame that it stores, 0: none."""
        self._restoring: dict[int, int] = {}
        """Number of the request -> id of the frame that it gives back."""
        self._suspects = set[int]()
        """Ids of frames that were being given back when the last process died. A frame over which two
        processes in a row died is dropped: it may be what kills them."""
        self._frames: OrderedDict[int, bytes] = OrderedDict()
        self._situation_at = float("-inf")
        self._running = self._overflowed = False
        self.ready: Ready | None = None
        self.failed = ""
        self.weak: tuple[str, ...] = ()
        self.camera = CameraStatus()
        self.delivered_at: float | None = None
        self.trouble = "vision starting"
        self.restarted = 0

    @property
    def memory(self) -> Memory:
        """Return the newest accepted copy. Only after the process was ready once, or with a saved memory."""
        assert self._memory is not None
        return self._memory

    @property
    def alive_at(self) -> float:
        """Return the monotonic seconds of the last sign of life; -inf while the process is not ready."""
        return self._reported_at if self._running else float("-inf")

    @property
    def answers_within(self) -> float:
        """Return the seconds within which each waiting answer has its outcome, or the process is lost."""
        return (MAX_JOBS + 1) * self._limit()

    @property
    def unreliable(self) -> bool:
        """Whether the process died three times within ten minutes."""
        return len(self._deaths) == _DEATHS and self._polled_at - self._deaths[0] <= _OFTEN

    def fileno(self) -> int | None:
        """Return the descriptor for `select`; None while there is no process. A restart changes it."""
        return None if self._child is None else self._child.fileno()

    def poll(self, now: float) -> list[Result]:
        """Return the results since the last call, oldest first; of several `Judged` only the newest."""
        if now - self._polled_at > _STALLED:
            self._reported_at = self._started_at = now
        self._polled_at = now
        if self._child is None:
            if now >= self._restart_at and not self.failed:
                self._start(now)
            return []
        if self._scenes and self._child.idle:
            self._send(Scenes(self._next_scenes()))
        results: list[Result] = []
        try:
            ended = self._child.ended()
            for packed in self._child.receive():
                report = checked(decode(packed), self._expected, time.monotonic())
                results += self._take_report(report, now)
        except (CodecError, BadReportError) as error:
            return _newest(results) + self._restart_later(
                f"sent nonsense ({error})", "vision sent nonsense", now
            )
        if self._overflowed:
            return _newest(results) + self._restart_later(
                "does not take what it is sent", "vision hangs", now
            )
        if self.failed and self.ready is not None:
            what = f"cannot be loaded ({self.failed})"
            return _newest(results) + self._restart_later(what, "vision cannot be loaded", now)
        if ended:
            return _newest(results) + self._restart_later(f"ended: {ended}", f"vision died ({ended})", now)
        silent, limit = now - max(self._reported_at, self._started_at), self._limit()
        if silent > limit:
            return _newest(results) + self._restart_later(
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
        """Request that an answer be applied; an `Applied` with `token` follows.

        frame_id: of the call's or hold's frame, 0: words alone. place: the call's, by default the vehicle's.
        False when too many answers wait, or the process hangs or is not ready.
        """
        return self._ask(token, lambda number: Answer(number, changes, frame_id, call_id, go, place))

    def restore(self, token: object, frame_id: int, png: bytes) -> bool:
        """Request that the frame of a call that was open at a restart be judged; an `Applied` follows.

        png: the frame as PNG. False as for `answer`.
        """
        self._remember_frame(frame_id, png)
        return self._ask(token, lambda number: self._restore(number, frame_id, png))

    def tune(self, settings: Settings) -> bool:
        """Judge frames by these settings from now on. No frame is judged before the first call of `tune`.

        False when the process hangs or is not ready.
        """
        if not self._takes_jobs():
            return False
        if not self._send(Tune(settings)):
            return False
        self._settings = settings
        return True

    def draw(self, frame_id: int, title: str, state: State, *, keep: bool = False) -> bool:
        """Request pictures of a recently judged frame; a `Drawn` follows. False when too many wait.

        keep: store the frame, because it is a call's or hold's: answers and taps may refer to it from now on.
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
        """Send where the vehicle is and whether it moves, at most five times a second."""
        ready = self._running and self._child is not None and self._child.idle
        if ready and now - self._situation_at >= _SITUATION_EVERY:
            self._situation_at = now
            self._send(Situation(place, moving))

    def has_stored_frame(self, frame_id: int) -> bool:
        """Whether answers may refer to this frame: it is stored, or a request to store it is under way."""
        return frame_id in self._frames or frame_id in self._drawing.values()

    def close(self) -> None:
        """Kill the process. The camera is free when this returns, unless its driver hangs."""
        if self._child is not None:
            self._child.close()
            self._child = None
        self._running = self._overflowed = False

    def _start(self, now: float) -> None:
        try:
            self._child = self._launch()
        except OSError as error:
            self._child = None
            self._restart_later(f"cannot be started ({error})", "vision cannot be started", now)
            return
        self._started_at = self._reported_at = now
        memory, first = self._memory, self._expected.last_frame + 1
        if memory is not None:
            self._scenes = deque(memory.history)
            memory = replace(memory, history=History(self._next_scenes(), memory.history.limit))
        self._send(Start(self._config, memory, self._revision, first, len(self._scenes)))

    def _next_scenes(self) -> tuple[Entry, ...]:
        return tuple(self._scenes.popleft() for _ in range(min(_SCENES, len(self._scenes))))

    def _limit(self) -> float:
        """Return the seconds of silence after which the process counts as hung."""
        if not self._running or self.ready is None:
            return self._restarts.loading
        return self._restarts.silent_for + 4.0 * self.ready.step

    def _take_report(self, report: object, now: float) -> list[Result]:
        self._reported_at = now
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
                self._take_ready(report, now)
            case Looked():
                if report.update is not None:
                    self._apply_update(report.update)
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
                if report.number not in self._unanswered:
                    raise BadReportError(f"an outcome of request {report.number}, which nobody made")
                if report.update is not None:
                    self._apply_update(report.update)
                frame_id = self._restoring.pop(report.number, None)
                if report.error and frame_id is not None:
                    self._frames.pop(frame_id, None)
                error = AnyTraverseError(report.error) if report.error else None
                return [Applied(self._unanswered.pop(report.number), report.outcome, error, self.memory)]
            case Drawn():
                if report.number not in self._drawing:
                    raise BadReportError(f"picture {report.number}, which nobody asked for")
                del self._drawing[report.number]
                if report.kept:
                    self._remember_frame(report.frame_id, report.png)
                return [report]
        return []

    def _apply_update(self, update: MemoryUpdate) -> None:
        """Apply an update to the memory. Raises BadReportError when it is not based on the present copy."""
        if update.base != self._revision or update.revision != self._revision + 1:
            raise BadReportError(f"memory {update.revision} on {update.base}, not on {self._revision}")
        self._memory = updated(self._memory, update)
        self._revision = update.revision
        self.weak = update.weak

    def _take_ready(self, ready: Ready, now: float) -> None:
        first = self.ready
        if first is not None and ready.model.id != first.model.id:
            self.failed = f"it is {ready.model.id} now, not {first.model.id}: restart the companion"
            return
        self._apply_update(ready.update)
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
            self._unanswered[self._numbers] = None
            self._send(self._restore(self._numbers, frame_id, png))

    def _restart_later(self, what: str, short: str, now: float) -> list[Result]:
        """Kill the process and plan its restart. Return the errors of the answers that waited.

        what: for the log. short: for the operator. A perceiver that never loaded is not tried again: the same
        files would fail again.
        """
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
        self._restart_at = now + wait
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
        asked = [token for token in self._unanswered.values() if token is not None]
        self._unanswered.clear()
        return (
            [Applied(token, None, error, self.memory) for token in asked] if self._memory is not None else []
        )

    def _takes_jobs(self) -> bool:
        if not self._running or self.ready is None:
            return False
        return self._polled_at - self._reported_at <= SILENT_AFTER + self.ready.step

    def _ask(self, token: object, request: Callable[[int], Request]) -> bool:
        if not self._takes_jobs() or len(self._unanswered) >= MAX_JOBS:
            return False
        self._numbers += 1
        if not self._send(request(self._numbers)):
            return False
        self._unanswered[self._numbers] = token
        return True

    def _send(self, request: Request) -> bool:
        if self._child is None:
            return False
        try:
            if self._child.send(encode(request)):
                return True
        except CodecError as error:
            log.error("a request was not sent to the vision process: %s", error)
        self._overflowed = True  # the next poll kills the process
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
    """Leave out each `Judged` that a newer one replaces, unless its frame changed the memory."""
    last = next((one for one in reversed(results) if isinstance(one, Judged)), None)
    return [one for one in results if not isinstance(one, Judged) or one is last or one.changed]
