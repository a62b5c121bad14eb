"""Handles requests and judges frames in the vision process. No I/O: messages in, messages out."""

from __future__ import annotations

import logging
import math
import time
from collections import OrderedDict, deque
from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Finding, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.findings import check_age
from anytraverse.frame import Frame
from anytraverse.grid import LocalGrid
from anytraverse.grid_map import GridMap
from anytraverse.ground import GroundRegion
from anytraverse.history import Place
from anytraverse.memory import Memory
from anytraverse.perception import weak_words
from anytraverse.roi import sectors
from companion.guide.arcs import Unsure, blind_of, plan
from companion.guide.plan import Plan
from companion.vehicle.motion import MotionReport, lean_at, pose_at
from companion.vision import pictures
from companion.vision.exposure import ADVICE, ExposureDetector
from companion.vision.freeze_detector import Luma, luma
from companion.vision.infrared import InfraredDetector
from companion.vision.memory_copy import update_from
from companion.vision.messages import (
    Apply,
    Done,
    Draw,
    Drawn,
    Encode,
    FrameJudged,
    GroundMap,
    MemoryUpdate,
    Planned,
    Report,
    Request,
    Restore,
    Situation,
    Tune,
    error_text,
)

log = logging.getLogger(__name__)

RECENT = 3
"""Judged frames that can still be drawn or stored: the supervisor is at most two frames behind."""
STORED_FRAMES = 3
"""Stored frames of calls and holds, to which answers and taps may refer."""
_LOGGED_AGAIN = 10.0
MAPPED_EVERY = 1.0
"""Seconds between two reports of the ground."""
_MOTIONS, _MOTIONS_EVERY = 32, 0.1
"""Reports of the vehicle's motion that are kept, and s from one to the next: there may be 50 a second."""


class Worker:
    """Judges frames and applies answers, one after the other. Nothing else calls the engine."""

    def __init__(self, engine: AnyTraverse, revision: int) -> None:
        """revision: the number of the engine's memory that the supervisor has."""
        self._engine = engine
        self._reported = engine.memory
        self.revision = revision
        self._tuning = 0
        """Number of the `Tune` in force."""
        self._situation = Situation(Place())
        self._motions: deque[MotionReport] = deque(maxlen=_MOTIONS)
        self._exposure_detector = ExposureDetector()
        self._badly_exposed = ""
        self._infrared_detector = InfraredDetector()
        self._recent: OrderedDict[int, Assessment] = OrderedDict()
        self._stored: OrderedDict[int, Assessment] = OrderedDict()
        self._earlier: dict[int, Assessment] = {}
        """What frames were judged as before they were judged again."""
        self._logged_at = float("-inf")
        self._grid, self._mapped_at = LocalGrid(), float("-inf")
        self._planned: Plan | None = None

    def handle(self, request: Request) -> list[Report]:
        """Handle a request, and return the reports that answer it."""
        match request:
            case Tune(number, settings):
                self._tuning, self._engine.settings = number, settings
            case Situation(motion=motion):
                self._situation = request
                latest = self._motions[-1].at if self._motions else -math.inf
                if motion is not None and motion.at >= latest + _MOTIONS_EVERY:
                    self._motions.append(motion)
            case Apply():
                return [self._answer(request)]
            case Restore():
                return [self._restore(request)]
            case Draw():
                return [self._draw(request)]
            case Encode():
                return [pictures.encoded(request, self.recent(request.frame_id))]
        return []

    def recent(self, frame_id: int) -> Assessment | None:
        """Return a frame that was judged recently or is stored, None for one that is gone."""
        return self._stored.get(frame_id) or self._recent.get(frame_id)

    def judge(self, frame: Frame) -> FrameJudged:
        """Judge a new frame. An exception makes the frame's assessment a fault."""
        started = time.monotonic()
        at, motions = frame.captured_at, self._motions
        reach = self._situation.reach
        frame = replace(frame, lean=lean_at(motions, at), pose=pose_at(motions, at), reach=reach)
        try:
            seen = self._engine.step(frame, started, self._situation.place)
        except Exception:
            self._log_failure(frame)
            seen = self._engine.fault(frame, time.monotonic(), "the perceiver failed")
        now, levels = time.monotonic(), luma(frame.image)
        seen = self._with_age(seen, now, self._camera_faults(levels, started))
        self._recent[frame.id] = seen
        while len(self._recent) > RECENT:
            self._recent.popitem(last=False)
        maps, region = seen.maps, self._engine.settings.region
        shares = sectors(maps.known, maps.drivable, region) if maps is not None else ()
        update, infrared = self._update(), self._infrared_detector.check(frame.image, started)
        duration = now - started
        return FrameJudged(seen, self.revision, now, duration, shares, levels, update, infrared, self._tuning)

    def remember_ground(self, seen: Assessment) -> GroundMap | None:
        """Mark in the grid what a judged frame shows; a frame with a fault shows nothing.

        Return what is known of the ground, once a second, and None where it is not known.
        """
        at = seen.frame.captured_at
        self._mark_ground(seen)
        found = GridMap.of(self._grid, at) if at >= self._mapped_at + MAPPED_EVERY else None
        if found is None:
            return None
        self._mapped_at = at
        return GroundMap(found)

    def plan(self, seen: Assessment) -> Planned | None:
        """Plan the way on for the errand, over the ground as it is remembered with this frame.

        None without an errand, of a frame with a fault, where the ground is not told in metres, and where the
        vehicle's pose is not known.
        """
        errand, ground, before = self._situation.errand, self._engine.settings.metres, self._planned
        self._planned = None
        if errand is None or ground is None or Reason.FAULT in seen.reasons:
            return None
        route, outline, far = errand
        try:
            blind = blind_of(ground.camera, outline.width)
            at = seen.frame.captured_at
            self._planned = plan(
                self._grid,
                route,
                outline,
                far,
                at,
                blind=blind,
                unsure=self._unsure(ground),
                before=before,
            )
        except Exception:  # without a plan the vehicle stops, or stands
            self._log_failure(seen.frame, "no way could be planned after frame %d")
        return None if self._planned is None else Planned(self._planned)

    def _unsure(self, ground: GroundRegion) -> Unsure:
        """Return what is called for where it stands in the region, too."""
        limits = self._engine.settings.thresholds
        return Unsure(limits.roi if limits.tile is None else min(limits.tile, limits.roi), ground.tile)

    def _mark_ground(self, seen: Assessment) -> None:
        ground, frame = self._engine.settings.metres, seen.frame
        try:
            if ground is None or seen.maps is None or Reason.FAULT in seen.reasons:
                self._grid.move(frame.pose, frame.captured_at)
            else:
                camera = ground.camera.leaning(*(frame.lean or (0.0, 0.0)))
                self._grid.update(seen.maps, camera, frame.pose, frame.captured_at)
        except Exception:  # it judges nothing, so that its failure is no fault
            self._log_failure(frame)
            self._grid.forget()

    def _camera_faults(self, levels: Luma, now: float) -> list[Finding]:
        """Return what has been wrong with the pictures for longer than T: badly exposed."""
        freshness, region = self._engine.settings.freshness, self._engine.settings.region
        name, seconds = self._exposure_detector.check(levels, region, now)
        name = name if seconds > freshness else ""
        if name != self._badly_exposed:
            self._badly_exposed = name
            log.warning("%s", f"{name}: {ADVICE[name]}" if name else "the picture is well exposed again")
        return [Finding.fault(name)] if name else []

    def _with_age(self, seen: Assessment, now: float, faults: list[Finding]) -> Assessment:
        """Set the age to that after judging. Add these faults, and one when the age is greater than T.

        The time of judging counts, since a view that took long to judge is old when it is used.
        """
        age, freshness = now - seen.frame.captured_at, self._engine.settings.freshness
        late = [] if Reason.FAULT in seen.reasons else check_age(age, freshness)
        return replace(seen, age=age, findings=(*seen.findings, *late, *faults))

    def _answer(self, request: Apply) -> Done:
        subject = self._stored.get(request.frame_id)
        try:
            if request.frame_id and subject is None:
                raise AnyTraverseError("its frame is lost: send it again when there is a new picture")
            outcome = self._engine.answer(
                request.operations,
                time.monotonic(),
                call=subject.observation if subject is not None else None,
                call_id=request.call_id,
                go=request.go,
                place=request.place or self._situation.place,
                missing_ok=request.missing_ok,
                match=request.match,
            )
        except AnyTraverseError as error:
            return Done(request.number, None, error_text(error), None)
        except Exception:
            log.exception("an answer could not be applied")
            return Done(request.number, None, "the perceiver failed on it: see the companion's log", None)
        return self._done(request.number, outcome)

    def _restore(self, request: Restore) -> Done:
        try:
            frame = Frame(request.frame_id, time.monotonic(), pictures.from_png(request.png))
            outcome = self._engine.answer((), time.monotonic(), call=self._engine.observe(frame))
        except Exception as error:
            log.exception("a stored frame could not be judged")
            return Done(request.number, None, error_text(error), None)
        if outcome.call is not None:
            self._store(request.frame_id, outcome.call)
        return self._done(request.number, outcome)

    def _done(self, number: int, outcome: AnswerOutcome) -> Done:
        """Report an outcome. Its frames are drawn as judged again, unless a request means the earlier one."""
        before = {**self._recent, **self._stored}
        self._earlier = {number: seen for number, seen in self._earlier.items() if number in before}
        for again in (outcome.call, outcome.newest):
            for frames in (self._stored, self._recent):
                if again is not None and again.frame.id in frames:
                    self._earlier[again.frame.id] = before[again.frame.id]
                    frames[again.frame.id] = again
        return Done(number, outcome, "", self._update(), self._tuning)

    def _draw(self, request: Draw) -> Drawn:
        seen = self.recent(request.frame_id)
        if seen is None:
            log.warning("no picture of %s: frame %d is gone", request.title, request.frame_id)
            return Drawn(request.number, request.frame_id, request.title)
        earlier = self._earlier.get(request.frame_id)
        if earlier is not None and request.roi is not None and earlier.roi == request.roi != seen.roi:
            # Words came before the supervisor knew what they change: its call has the earlier figures.
            seen = earlier
        if request.store:
            self._store(request.frame_id, seen)
        region = self._engine.settings.at(seen.frame.lean, seen.frame.reach).region
        return pictures.drawn(request, seen, region)

    def _store(self, frame_id: int, seen: Assessment) -> None:
        self._stored[frame_id] = seen
        self._stored.move_to_end(frame_id)
        while len(self._stored) > STORED_FRAMES:
            self._stored.popitem(last=False)

    def _update(self) -> MemoryUpdate | None:
        """Return the memory's change since the last report of it; None: no change."""
        before, memory = self._reported, self._engine.memory
        if memory is before:
            return None
        self._reported = memory
        self.revision += 1
        return update_from(before, memory, self.revision, self.revision - 1, self._weak(memory))

    def _weak(self, memory: Memory) -> tuple[str, ...]:
        return weak_in_use(self._engine, memory)

    def _log_failure(self, frame: Frame, text: str = "frame %d could not be judged") -> None:
        """Log the exception at most every ten seconds, since it may happen with every frame."""
        now = time.monotonic()
        if now - self._logged_at >= _LOGGED_AGAIN:
            self._logged_at = now
            log.exception(text, frame.id)


def weak_in_use(engine: AnyTraverse, memory: Memory) -> tuple[str, ...]:
    """Return the words in use that the perceiver recognises badly by name and that have no tap."""
    named = [word for word in memory.preferences if word not in memory.examples]
    return weak_words(engine.perceiver, named)
