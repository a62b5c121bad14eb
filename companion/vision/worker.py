"""What the vision process does with requests and frames. No process, no socket: messages in, messages out."""

from __future__ import annotations

import logging
import time
from collections import OrderedDict
from dataclasses import replace

from anytraverse.answers import AnswerOutcome, Changes
from anytraverse.assessment import Assessment, Finding, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.history import Place
from anytraverse.judging import check_age
from anytraverse.memory import Memory
from anytraverse.perception import weak_words
from anytraverse.roi import sectors
from companion.vision import pictures
from companion.vision.freeze_detector import FrozenPicture
from companion.vision.messages import (
    Answer,
    Done,
    Draw,
    Drawn,
    Looked,
    MemoryUpdate,
    Report,
    Request,
    Restore,
    Situation,
    Tune,
    told,
    update_from,
)

log = logging.getLogger(__name__)

RECENT = 3
"""Judged frames that can still be drawn or kept: the supervisor is at most two behind."""
KEPT = 3
"""Frames of calls and holds that can be answered and tapped in."""
_LOGGED_AGAIN = 10.0


class Worker:
    """Judges frames and applies answers, one after the other. It alone touches the engine."""

    def __init__(self, engine: AnyTraverse, revision: int) -> None:
        """revision: number of the engine's memory."""
        self._engine = engine
        self._told = engine.memory
        self.revision = revision
        self._situation = Situation(Place(), moving=False)
        self._frozen = FrozenPicture()
        self._recent: OrderedDict[int, Assessment] = OrderedDict()
        self._kept: OrderedDict[int, Assessment] = OrderedDict()
        self._logged_at = float("-inf")

    def handle(self, request: Request) -> list[Report]:
        """Do what the supervisor asks for."""
        match request:
            case Tune(settings):
                self._engine.settings = settings
            case Situation():
                self._situation = request
            case Answer():
                return [self._answer(request)]
            case Restore():
                return [self._restore(request)]
            case Draw():
                return [self._draw(request)]
        return []

    def look(self, frame: Frame) -> Looked:
        """Judge a new frame. An error over it is a fault of that frame."""
        started = time.monotonic()
        try:
            seen = self._engine.step(frame, started, self._situation.place)
        except Exception:
            self._log_failure(frame)
            seen = self._engine.fault(frame, time.monotonic(), "the perceiver failed")
        now = time.monotonic()
        still = self._frozen.seconds(frame.image, started, moving=self._situation.moving)
        seen = self._dated(seen, now, still)
        self._recent[frame.id] = seen
        while len(self._recent) > RECENT:
            self._recent.popitem(last=False)
        maps, region = seen.maps, self._engine.settings.region
        shares = sectors(maps.known, maps.drivable, region) if maps is not None else ()
        update = self._update()
        return Looked(seen, self.revision, now, now - started, shares, update)

    def _dated(self, seen: Assessment, now: float, still: float) -> Assessment:
        """With its age after judging: what took too long to judge is no fresh view, however young it was.

        Nor is a picture that has not changed for longer than T while the vehicle moved, `still` seconds.
        """
        age, freshness = now - seen.frame.captured_at, self._engine.settings.freshness
        late = [] if Reason.FAULT in seen.reasons else check_age(age, freshness)
        if still > freshness:
            late.append(Finding.fault("camera frozen"))
        return replace(seen, age=age, findings=(*seen.findings, *late))

    def _answer(self, request: Answer) -> Done:
        subject = self._kept.get(request.frame_id)
        try:
            if request.frame_id and subject is None:
                raise AnyTraverseError("its frame is lost: send it again when there is a new picture")
            outcome = self._engine.answer(
                request.changes,
                time.monotonic(),
                call=subject.observation if subject is not None else None,
                call_id=request.call_id,
                go=request.go,
                place=request.place or self._situation.place,
            )
        except AnyTraverseError as error:
            return Done(request.number, None, told(error), None)
        except Exception:
            log.exception("an answer could not be applied")
            return Done(request.number, None, "the perceiver failed on it: see the companion's log", None)
        return self._done(request.number, outcome)

    def _restore(self, request: Restore) -> Done:
        try:
            frame = Frame(request.frame_id, time.monotonic(), pictures.from_png(request.png))
            outcome = self._engine.answer(Changes(), time.monotonic(), call=self._engine.observe(frame))
        except Exception as error:
            log.exception("a stored frame could not be judged")
            return Done(request.number, None, told(error), None)
        if outcome.call is not None:
            self._keep(request.frame_id, outcome.call)
        return self._done(request.number, outcome)

    def _done(self, number: int, outcome: AnswerOutcome) -> Done:
        """What was judged again is what is drawn from now on."""
        for again in (outcome.call, outcome.newest):
            for frames in (self._kept, self._recent):
                if again is not None and again.frame.id in frames:
                    frames[again.frame.id] = again
        return Done(number, outcome, "", self._update())

    def _draw(self, request: Draw) -> Drawn:
        seen = self._kept.get(request.frame_id) or self._recent.get(request.frame_id)
        if seen is None:
            log.warning("no picture of %s: frame %d is gone", request.title, request.frame_id)
            return Drawn(request.number, request.frame_id, request.title)
        if request.keep:
            self._keep(request.frame_id, seen)
        region = self._engine.settings.region
        return pictures.drawn(request, seen, region)

    def _keep(self, frame_id: int, seen: Assessment) -> None:
        self._kept[frame_id] = seen
        self._kept.move_to_end(frame_id)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)

    def _update(self) -> MemoryUpdate | None:
        """The memory's change since it was told last."""
        before, memory = self._told, self._engine.memory
        if memory is before:
            return None
        self._told = memory
        self.revision += 1
        return update_from(before, memory, self.revision, self.revision - 1, self._weak(memory))

    def _weak(self, memory: Memory) -> tuple[str, ...]:
        return weak_in_use(self._engine, memory)

    def _log_failure(self, frame: Frame) -> None:
        """Once in a while: it may happen with every frame."""
        now = time.monotonic()
        if now - self._logged_at >= _LOGGED_AGAIN:
            self._logged_at = now
            log.exception("frame %d could not be judged", frame.id)


def weak_in_use(engine: AnyTraverse, memory: Memory) -> tuple[str, ...]:
    """The words in use that the perceiver finds badly by name and that no tap explains."""
    named = [word for word in memory.preferences if word not in memory.examples]
    return weak_words(engine.perceiver, named)
