"""Sends the vision process requests, and takes its reports. `watchdog` starts, kills and restarts it.

Nothing here blocks. Each report is checked before it is used.
"""

from __future__ import annotations

import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from msgspec import structs

from anytraverse.assessment import Assessment, Finding
from anytraverse.history import Place
from anytraverse.judging import Settings
from anytraverse.memory import Memory
from anytraverse.operations import Operation
from anytraverse.preferences import Preferences
from anytraverse.roi import RoiFigures
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.config.radio import LinkSection
from companion.config.web import WebSection
from companion.guide.plan import Errand
from companion.system.watchdog import Failure, Restarts, Watchdog
from companion.vehicle.motion import MotionReport
from companion.vision.checks import MOST_TUNINGS, BadReportError, Expected, check_report
from companion.vision.child import Child
from companion.vision.codec import CodecError, decode, encode_trusted
from companion.vision.freeze_detector import FreezeDetector
from companion.vision.judging_rate import JudgingRate
from companion.vision.measured_pace import MeasuredPace
from companion.vision.memory_copy import MemoryCopy
from companion.vision.messages import (
    Alive,
    Apply,
    Done,
    Draw,
    Drawn,
    Encode,
    Encoded,
    Failed,
    FrameJudged,
    GroundMap,
    Logged,
    MemoryUpdate,
    Planned,
    Ready,
    Request,
    Restore,
    Scenes,
    Situation,
    Start,
    Tune,
    VideoMarks,
)
from companion.wire.ids import State
from companion.wire.packing import clean

log = logging.getLogger(__name__)

OF_AN_OWNER = 2
"""Answers of one owner that may wait for their outcome at once."""
MAX_JOBS = 6 * OF_AN_OWNER
"""Answers of all: two of each operator with a share of the link, of the others together, and of the page."""
MAX_DRAWINGS = 16
STORED_FRAMES = 2
"""Stored frames, of the open call and the hold. A restarted process gets those that have come as PNG."""
_SITUATION_EVERY = 0.2
_LONGEST_NAME = 100
_READING = 0.02
"""Seconds of a `poll` after which no further report is read: it waits for the next."""


VISION_LOST = "vision restarted: send it again"
"""The error of a `Done` where the process died before it reported the outcome; the request had no effect."""


class VisionResult(NamedTuple):
    """A report, and what is known beside it.

    memory: as it is after the report. token: of a `Done`, what the caller of `answer` passed. None: a stored
    frame was given to a new process. turned: the words whose sign it turned -> weight before and after.
    """

    report: FrameJudged | Done | Drawn | Encoded | GroundMap | Planned
    memory: Memory
    token: object = None
    turned: Mapping[str, tuple[float, float]] = MappingProxyType({})


class _Asked(NamedTuple):
    """A request that waits. token: its caller's. frame_id: of the frame that it gives back, 0: none.

    owner: of `VisionClient.answer`.
    """

    token: object
    frame_id: int
    at: float
    owner: object = None


class VisionClient:
    """Converses with the vision process. The main loop calls `poll` in every turn.

    watchdog: whether the process lives. rate: how often it is to judge. weak: words in use that the perceiver
    recognises badly. camera, delivered_at: as last reported. infrared: whether the camera shows infrared,
    None: not known yet. ready: the first report that a perceiver was loaded. failed: why it cannot be loaded,
    "" otherwise. trouble: why nothing is judged now, "" while all is well.
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
        self.watchdog: Watchdog[Child] = Watchdog(launch, restarts, "vision process")
        self.rate = JudgingRate(config.camera.rate, config.freshness, config.call.window)
        self.pace = MeasuredPace(config.perceiver.scene_every)
        self._config = config
        self._copy = MemoryCopy(memory, config.journal.scenes)
        self._expected = Expected(first_frame - 1, {})
        self._unread = deque[bytes]()
        self._settings: Settings | None = None
        self._numbers = 0
        self._unanswered: dict[int, _Asked] = {}
        """Number of the request -> what was asked, the oldest first."""
        self._drawing: dict[int, Draw] = {}
        """The requests that wait, by number."""
        self._encoding: Encode | None = None
        """The request to encode a frame that has no report yet."""
        self._suspects = set[int]()
        """Ids of frames that were being given back when the last process died. A frame over which two
        processes in a row died is dropped: it may be what kills them."""
        self._frames: OrderedDict[int, bytes] = OrderedDict()
        self._situation_at = float("-inf")
        self._motion: MotionReport | None = None
        self._freeze_detector = FreezeDetector()
        self._moved, self._situated_at = 0.0, float("inf")
        """Seconds of motion since the newest frame; when `situation` was called last."""
        self._overflowed = False
        self.ready: Ready | None = None
        self.failed = ""
        self.weak: tuple[str, ...] = ()
        self.camera = CameraStatus()
        self.infrared: bool | None = None
        self.delivered_at: float | None = None
        self.trouble = "vision starting"

    @property
    def memory(self) -> Memory:
        """Return the newest accepted copy, with which a restarted process begins.

        Only after the process was ready once, or with a saved memory.
        """
        assert self._copy.memory is not None
        return self._copy.memory

    @property
    def words(self) -> Preferences:
        """Return the words in use. Only where there is a `memory`."""
        return self.memory.preferences

    @property
    def misled_by_infrared(self) -> bool:
        """Whether the camera shows infrared, and neither perceiver nor configuration handle that."""
        trained = self.ready is not None and self.ready.model.infrared
        return self.infrared is True and not self._config.camera.handles_infrared(trained=trained)

    @property
    def newest_request(self) -> int:
        """Return the number of the newest request; a `Drawn` has that of its request."""
        return self._numbers

    @property
    def answers_within(self) -> float:
        """Return the seconds within which each waiting answer has its outcome, or the process is killed."""
        return (MAX_JOBS + 1) * self.watchdog.silence_limit

    def fileno(self) -> int | None:
        """Return the descriptor for `select`; None while there is no process. A restart changes it."""
        child = self.watchdog.child
        return None if child is None else child.fileno()

    def poll(self, now: float) -> list[VisionResult]:
        """Return the results since the last call, oldest first; of several judged frames only the newest."""
        self.watchdog.polled(now)
        child = self.watchdog.child
        if child is None:
            if self.watchdog.may_start(now) and not self.failed:
                self._start(now)
            return []
        if child.idle and (scenes := self._copy.next_scenes()):
            self._send(Scenes(scenes))
        results: list[VisionResult] = []
        try:
            ended = child.ended()
            self._unread = self._unread or deque(child.receive())
            until = time.monotonic() + _READING
            while self._unread and time.monotonic() <= until:
                report = check_report(decode(self._unread.popleft()), self._expected, time.monotonic())
                results += self._take_report(report, now)
        except (CodecError, BadReportError) as error:
            failure: Failure | None = Failure(f"sent nonsense ({error})", "sent nonsense")
        except OSError as error:
            failure = _not_started(error)
        else:
            failure = self._failure("" if self._unread else ended, now)
        return _newest(results) + ([] if failure is None else self._restart(failure, now))

    def answer(
        self,
        token: object,
        operations: tuple[Operation, ...],
        *,
        frame_id: int = 0,
        call_id: int = 0,
        go: bool = False,
        place: Place | None = None,
        missing_ok: bool = False,
        match: int | None = None,
        owner: object = None,
    ) -> bool:
        """Request that an answer be applied; a `Done` with `token` follows.

        frame_id: of the call's or hold's frame, 0: words alone. place: the call's, by default the vehicle's.
        missing_ok, match: as of `AnyTraverse.answer`.
        owner: whose answers are bounded together, None: no one's. False when too many answers wait, in all or
        of this owner, or the process hangs or is not ready.
        """
        if owner is not None and sum(one.owner == owner for one in self._unanswered.values()) >= OF_AN_OWNER:
            return False
        return self._ask(
            token,
            lambda number: Apply(number, operations, frame_id, call_id, go, place, missing_ok, match),
            owner=owner,
        )

    def restore(self, token: object, frame_id: int, png: bytes) -> bool:
        """Request that the frame of a call that was open at a restart be judged; a `Done` follows.

        png: the frame as PNG. False as for `answer`.
        """
        self._remember_frame(frame_id, png)
        return self._ask(token, lambda number: Restore(number, frame_id, png), frame_id)

    def tune(self, settings: Settings) -> bool:
        """Judge frames by these settings from now on. No frame is judged before the first call of `tune`.

        False when the process hangs or is not ready, or too many settings wait for a frame. The first ones
        reach the next process all the same.
        """
        if self._settings is None:
            self._settings = settings
        waits = len(self._expected.settings) >= MOST_TUNINGS
        return self.watchdog.responsive and not waits and self._tune(settings)

    def draw(
        self,
        frame_id: int,
        title: str,
        state: State,
        *,
        store: bool = False,
        video: VideoMarks | None = None,
        roi: RoiFigures | None = None,
    ) -> bool:
        """Request pictures of a recently judged frame; a `Drawn` follows. False when too many wait.

        store: whether to store the frame, because it is a call's or hold's: answers and taps may refer to it.
        video: how to draw it for the video. roi: as for `Draw`.
        """
        most = MAX_DRAWINGS + (STORED_FRAMES if store else 0)
        if not self.watchdog.running or len(self._drawing) >= most:
            log.warning("no picture of %s: the vision process does not draw now", title)
            return False
        self._numbers += 1
        request = Draw(self._numbers, frame_id, title, state, store, video, roi)
        if not self._send(request):
            return False
        self._drawing[request.number] = request
        return True

    def encode(self, frame_id: int) -> bool:
        """Request that a recently judged frame be encoded for the recording; an `Encoded` follows.

        False while another one is being encoded, or nothing is judged.
        """
        child = self.watchdog.child
        if self._encoding or not self.watchdog.running or child is None or not child.idle:
            return False
        self._numbers += 1
        request = Encode(self._numbers, frame_id)
        if not self._send(request):
            return False
        self._encoding = request
        return True

    def situation(
        self,
        place: Place,
        motion: MotionReport | None,
        now: float,
        *,
        moving: bool,
        reach: float | None = None,
        errand: Errand | None = None,
    ) -> None:
        """Send where the vehicle is, and the rate, five times a second, and each new report of its motion.

        reach: as in `Frame`. errand: what ways are planned for, None: nothing. moving: whether it has moved
        since the last call, so that two pictures in a row must differ.
        """
        self._moved += max(0.0, now - self._situated_at) if moving else 0.0
        self._situated_at = now
        child = self.watchdog.child
        idle = self.watchdog.running and child is not None and child.idle
        if idle and (now - self._situation_at >= _SITUATION_EVERY or motion != self._motion):
            self._situation_at, self._motion = now, motion
            self._send(Situation(place, self.rate.value, motion, reach, errand))

    def has_stored_frame(self, frame_id: int) -> bool:
        """Whether answers may refer to this frame: it is stored, or a request to store it is under way."""
        asked = any(one.store and one.frame_id == frame_id for one in self._drawing.values())
        return asked or frame_id in self._frames

    def close(self) -> None:
        """Kill the process. The camera is free when this returns, unless its driver hangs."""
        self.watchdog.kill()
        self._overflowed = False

    def _start(self, now: float) -> None:
        try:
            self.watchdog.start(now)
        except OSError as error:
            self._restart(_not_started(error), now)
            return
        self._unread.clear()
        memory, more = self._copy.first_part()
        first = self._expected.last_frame + 1
        # A picture may break into the process: what it does not need to know, it is not told.
        config = replace(self._config, link=LinkSection(), web=WebSection())
        self._send(Start(config, memory, self._copy.revision, first, more))

    def _failure(self, ended: str, now: float) -> Failure | None:
        if self._overflowed:
            return Failure("does not take what it is sent", "hangs")
        if self.failed and self.ready is not None:
            return Failure(f"cannot be loaded ({self.failed})", "cannot be loaded")
        oldest = next(iter(self._unanswered.values()), None)
        if oldest is not None and now - oldest.at > self.answers_within:
            return Failure(f"did not answer within {self.answers_within:.0f} s", "hangs")
        return self.watchdog.failure(ended, now)

    def _take_report(self, report: object, now: float) -> list[VisionResult]:
        self.watchdog.reported(now)
        if isinstance(report, (FrameJudged, Done, Drawn, Encoded)) and not self.watchdog.running:
            raise BadReportError(f"{type(report).__name__} before it was ready")
        match report:
            case Logged():
                _log(report)
            case Alive(camera, delivered_at):
                self.camera, self.delivered_at = camera, delivered_at
            case Failed(text):
                self.failed = text
            case Scenes(rows):
                self._copy.add(rows)
            case Ready():
                if self.watchdog.running:
                    raise BadReportError("ready a second time")
                self._take_ready(report, now)
            case FrameJudged():
                if report.update is not None:
                    self._apply_update(report.update)
                known = self._copy.revision
                if report.revision != known:
                    raise BadReportError(f"a frame under revision {report.revision}, not {known}")
                # A new process does not know it yet: the camera is the same.
                self.infrared = self.infrared if report.infrared is None else report.infrared
                report = structs.replace(report, assessment=self._unless_frozen(report))
                self.rate.judged(report.duration)
                self.pace.judged(report.duration, report.at)
                return [VisionResult(report, self.memory)]
            case Done():
                if report.number not in self._unanswered:
                    raise BadReportError(f"an outcome of request {report.number}, which nobody made")
                before = self.memory
                if report.update is not None:
                    self._apply_update(report.update)
                asked = self._unanswered.pop(report.number)
                if report.error:
                    self._frames.pop(asked.frame_id, None)
                return [VisionResult(report, self.memory, asked.token, before.turned(self.memory))]
            case Drawn():
                draw = self._drawing.pop(report.number, None)
                told = report.frame_id, report.title, report.stored
                if draw is None or told != (draw.frame_id, draw.title, report.stored and draw.store):
                    raise BadReportError(f"picture {report.number}, which nobody asked for")
                if report.stored:
                    self._remember_frame(report.frame_id, report.png)
                return [VisionResult(report, self.memory)]
            case Encoded():
                if self._encoding != Encode(report.number, report.frame_id):
                    raise BadReportError(f"encoded frame {report.number}, which nobody asked for")
                self._encoding = None
                return [VisionResult(report, self.memory)]
            case GroundMap() | Planned():
                return [VisionResult(report, self.memory)]
        return []

    def _unless_frozen(self, report: FrameJudged) -> Assessment:
        """Return the frame's assessment, with a fault where the picture has stood still for longer than T."""
        seen, limits = report.assessment, self._expected.settings_of(report.tuning)
        still, self._moved = self._freeze_detector.seconds(report.luma, self._moved), 0.0
        if still <= limits.freshness:
            return seen
        return replace(seen, findings=(*seen.findings, Finding.fault("camera frozen")))

    def _apply_update(self, update: MemoryUpdate) -> None:
        self._copy.apply(update)
        self.weak = update.weak

    def _take_ready(self, ready: Ready, now: float) -> None:
        first = self.ready
        if first is not None and ready.model.id != first.model.id:
            self.failed = f"it is {ready.model.id} now, not {first.model.id}: restart the companion"
            return
        self._apply_update(ready.update)
        self._expected.settings = {}
        self.watchdog.ready((first or ready).step, now)
        self.pace.started(ready.step, now)
        self.trouble = ""
        if first is None:
            self.ready = ready
            return
        log.info("the vision process is back")
        if self._settings is not None:
            self._tune(self._settings)
        for frame_id, png in self._frames.items():
            self._numbers += 1
            self._unanswered[self._numbers] = _Asked(None, frame_id, now)
            self._send(Restore(self._numbers, frame_id, png))

    def _tune(self, settings: Settings) -> bool:
        self._numbers += 1
        if not self._send(Tune(self._numbers, settings)):
            return False
        self._settings = settings
        self._expected.settings[self._numbers] = settings
        return True

    def _restart(self, failure: Failure, now: float) -> list[VisionResult]:
        """Have the process killed and restarted. Return the errors of the answers that waited.

        A perceiver that never loaded is not tried again: the same files would fail again.
        """
        if self.failed and self.ready is None:
            self.close()
            return []
        self.watchdog.restart_later(failure.cause, now)
        self._overflowed = False
        self.failed = ""
        self.trouble = f"vision {failure.trouble}"
        self.camera = replace(self.camera, state=CameraState.CONNECTING, reason=failure.cause)
        self.delivered_at = None
        self._drawing.clear()
        self._encoding = None
        restoring = {asked.frame_id for asked in self._unanswered.values() if asked.frame_id}
        dropped, self._suspects = restoring & self._suspects, restoring
        self._frames = OrderedDict(
            (number, png) for number, png in self._frames.items() if png and number not in dropped
        )
        waited, self._unanswered = self._unanswered, {}
        if self._copy.memory is None:
            return []
        return [
            VisionResult(Done(number, None, VISION_LOST, None), self.memory, asked.token)
            for number, asked in waited.items()
            if asked.token is not None
        ]

    def _ask(
        self, token: object, request: Callable[[int], Request], frame_id: int = 0, owner: object = None
    ) -> bool:
        if not self.watchdog.responsive or len(self._unanswered) >= MAX_JOBS:
            return False
        self._numbers += 1
        if not self._send(request(self._numbers)):
            return False
        self._unanswered[self._numbers] = _Asked(token, frame_id, time.monotonic(), owner)
        return True

    def _send(self, request: Request) -> bool:
        child = self.watchdog.child
        if child is None:
            return False
        try:
            if child.send(encode_trusted(request)):
                return True
        except CodecError as error:
            log.error("a request was not sent to the vision process: %s", error)
        self._overflowed = True  # the next poll kills the process
        return False

    def _remember_frame(self, frame_id: int, png: bytes) -> None:
        self._frames[frame_id] = png
        self._frames.move_to_end(frame_id)
        while len(self._frames) > STORED_FRAMES:
            self._frames.popitem(last=False)


def _log(said: Logged) -> None:
    """Log lines of the process. A logger of the name that it gives would never be freed."""
    if log.isEnabledFor(said.level):
        lines = (one.replace("\t", "    ") for one in said.text.splitlines())
        text = "\n  ".join(one[: len(one) - len(one.lstrip(" "))] + clean(one) for one in lines)
        name = clean(said.name)[:_LONGEST_NAME]
        log.handle(logging.LogRecord(name, said.level, "", 0, text, None, None))


def _not_started(error: OSError) -> Failure:
    return Failure(f"cannot be started ({error})", "cannot be started")


def _newest(results: list[VisionResult]) -> list[VisionResult]:
    """Leave out each judged frame that a newer one replaces, unless it changed the memory."""
    last = next((one for one in reversed(results) if isinstance(one.report, FrameJudged)), None)
    return [one for one in results if one is last or not _only_judged(one)]


def _only_judged(result: VisionResult) -> bool:
    return isinstance(result.report, FrameJudged) and result.report.update is None
