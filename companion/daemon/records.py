"""Writes what may be read later: files and pictures of calls and holds."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.memory import Memory
from companion.calls.decisions import Call, CallClosed, CallOpened, HoldMoved, WouldHold
from companion.calls.hold import HoldEvent
from companion.calls.machine import OperatorCalls
from companion.calls.summary import recorded
from companion.daemon.turn import AnswerStored, CallShown, Decided, Event, Observer, Turn
from companion.storage import Journal, JournalError
from companion.storage.call_files import CallFiles, PictureArchive, address, scene_name, scene_picture
from companion.storage.writer import Writer
from companion.vision.client import MAX_DRAWINGS, STORED_FRAMES, VisionClient, VisionResult
from companion.vision.messages import Drawn, FrameJudged
from companion.wire import notices, texts
from companion.wire.call_report import FIGURES_MEMBERS, NearestScene
from companion.wire.ids import Kind

log = logging.getLogger(__name__)


class Records(Observer):
    """Observes calls, holds and judged frames, and queues files and pictures of them for the writer."""

    def __init__(
        self,
        vision: VisionClient,
        calls: OperatorCalls,
        writer: Writer,
        archive: PictureArchive,
        files: CallFiles,
    ) -> None:
        self._vision = vision
        self._calls = calls
        self._writer = writer
        self._archive = archive
        self._files = files
        self._drawing: OrderedDict[int, int] = OrderedDict()
        """Number of a request to draw -> id of the call or hold whose picture it is, 0: the archive's."""
        self._first_scene = 0, ""
        """Request to draw the first reference, and the name of its picture until it is drawn."""
        self._shown = 0, ""
        """Id of the newest call or hold, and the path of its picture for the ground, "" without one."""
        self._answers: tuple[int, list[Mapping[str, Any]]] = 0, []
        """Id of the newest call, and its answers."""

    def restore(self, journal: Journal) -> None:
        """Read the answers to a call that was open at the restart, before the first turn."""
        call = self._calls.call
        if call is None:
            return
        self._answers = call.id, []
        try:
            self._answers[1].extend(journal.answers(call.id))
        except JournalError as error:
            log.warning("the answers to call %d are lost: %s", call.id, error)

    def picture_of(self, number: int) -> str:
        """Return the path by which the ground reads the picture of a call or hold, "" without one."""
        return self._shown[1] if number == self._shown[0] else ""

    def happened(self, event: Event, turn: Turn) -> None:
        """Queue what an event adds to files and pictures."""
        match event:
            case Decided(CallOpened(call)):
                self._answers = call.id, []
            case CallShown():
                self._call_shown(event, turn)
            case AnswerStored(target, record):
                self._answered(target, record)
            case Decided(CallClosed(call), at=at):
                self._call_closed(call, at)
            case Decided(HoldMoved(hold, HoldEvent.RESUMED)):
                kind = Kind.CALL if hold.id == self._answers[0] else Kind.HOLD
                self._draw_newest(f"{texts.name(kind, hold.id)} drives on", turn)
            case Decided(WouldHold(reasons, number)) if self._calls.call is None:
                self._draw_newest(notices.would_hold(number, sorted(one.value for one in reasons)), turn)
            case VisionResult(FrameJudged() as judged, memory):
                self._judged(judged, memory, turn)
            case VisionResult(Drawn() as drawn):
                self._drawn(drawn)

    def _call_shown(self, shown: CallShown, turn: Turn) -> None:
        """Write the file of a call, so that all show the same figures, and expect its picture."""
        if shown.drawing is None:
            self._draw(shown.seen, shown.title, turn)
            return
        picture = address(f"{shown.number}.jpg") if shown.drawing and self._archive.wanted else ""
        self._shown = shown.number, picture
        if shown.drawing:
            self._expect(shown.drawing, shown.number)
        call, seen = shown.call, shown.seen
        if call is None:
            return
        answers = list(self._answers[1]) if call.id == self._answers[0] else []
        told = replace(recorded(call), nearest=self._nearest(call.id, seen))
        figures = told.document((*FIGURES_MEMBERS, "why", "nearest"))
        job = partial(self._files.begin_record, call.id, figures, answers, self._remembered())
        self._writer.queue_job("record", job)

    def _answered(self, target: int, record: Mapping[str, Any]) -> None:
        if target == self._answers[0]:
            self._answers[1].append(record)
        self._writer.queue_job("record", partial(self._files.add_answer, target, record))

    def _call_closed(self, call: Call, at: float) -> None:
        told = replace(recorded(call), closed=at).document(("reasons", "outcome", "closed"))
        self._writer.queue_job("record", partial(self._files.close_record, call.id, told))

    def _judged(self, judged: FrameJudged, memory: Memory, turn: Turn) -> None:
        """Have a picture drawn of a match, or of the first reference, so that it is shown when it matches."""
        seen, scenes, adoption = judged.assessment, memory.history, memory.adoption
        if seen.adopted is not None:
            title = notices.known_place(adoption.call_id, adoption.similarity) if adoption is not None else ""
            self._draw(seen, title, turn)
        elif (
            judged.update is not None
            and scenes
            and not scenes[-1].call_id
            and self._draw(seen, "first place", turn)
        ):
            self._first_scene = self._vision.newest_request, scene_name(scenes[-1])

    def _draw_newest(self, title: str, turn: Turn) -> None:
        if (newest := self._calls.reason_filter.newest) is not None:
            self._draw(newest, title, turn)

    def _draw(self, seen: Assessment, title: str, turn: Turn) -> bool:
        """Have a picture of a frame drawn for the archive. Whether it will be."""
        if not self._archive.wanted or not self._vision.draw(seen.frame.id, title, turn.state, roi=seen.roi):
            return False
        self._expect(self._vision.newest_request, 0)
        return True

    def _expect(self, request: int, number: int) -> None:
        self._drawing[request] = number
        while len(self._drawing) > MAX_DRAWINGS + STORED_FRAMES:  # vision lost the others
            self._drawing.popitem(last=False)

    def _drawn(self, drawn: Drawn) -> None:
        """Queue a picture, if it was requested here."""
        number = self._drawing.pop(drawn.number, None)
        if number is None:
            return
        if drawn.panel and drawn.number == self._first_scene[0]:
            names = {scene_name(entry) for entry in self._vision.memory.history if not entry.call_id}
            write_scene = partial(self._files.write_scene, self._first_scene[1], drawn.panel, names)
            self._writer.queue_job("picture", write_scene)
            self._first_scene = 0, ""
        elif not self._archive.wanted or not drawn.panel:
            if number and number == self._shown[0]:
                self._shown = number, ""
        elif number and drawn.stored and number == self._shown[0] and drawn.thumbnail:
            write = partial(self._write_pictures, number, drawn, self._remembered())
            self._writer.queue_job("picture", write)
        else:
            self._writer.queue_job("picture", partial(self._archive.add, drawn.panel, drawn.title))

    def _nearest(self, number: int, seen: Assessment) -> NearestScene | None:
        """Describe the remembered scene most like a call's frame, of those that another answer taught."""
        memory = self._vision.memory
        if seen.observation is None:
            return None
        match = memory.nearest_answered(seen.observation.embedding, {number})
        if match is None:
            return None
        words, picture = memory.taught(match.entry), scene_picture(match.entry)
        return NearestScene(match.entry.call_id or None, match.similarity, words, picture)

    def _remembered(self) -> frozenset[int]:
        return frozenset(entry.call_id for entry in self._vision.memory.history)

    def _write_pictures(self, number: int, drawn: Drawn, remembered: frozenset[int]) -> None:
        """Write the pictures of a call or hold. Runs in the writer's thread."""
        try:
            large = self._archive.add(drawn.panel, drawn.title)
            self._files.write_pictures(number, drawn.thumbnail, large, drawn.raw, remembered)
        except Exception:
            if self._shown[0] == number:
                self._shown = number, ""
            raise
