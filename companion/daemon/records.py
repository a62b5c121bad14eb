"""Writes what may be read later: files and pictures of calls and holds, and the status file."""

from __future__ import annotations

import json
import logging
import os
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.history import Entry
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.summary import recorded
from companion.daemon.answers.handler import Reply
from companion.daemon.persistence import Persistence
from companion.storage import Journal, JournalError
from companion.storage.call_files import CallFiles, PictureArchive, address, scene_name, scene_picture
from companion.storage.writer import Writer
from companion.system.atomic_write import write_atomically
from companion.vision.client import VisionClient
from companion.vision.messages import Done, Drawn, FrameJudged
from companion.wire.call_report import FIGURES, NearestScene
from companion.wire.ids import State
from companion.wire.texts import REASONS

log = logging.getLogger(__name__)

_CALL_FRAME = object()
_RECENT = 1200
"""Newest frames whose times are written to the last status file."""


class Records:
    """Has frames of calls and holds stored and drawn by vision, and queues what is to be read later.

    Answers and taps refer to those frames. One that vision lost is restored from the journal, or replaced.
    """

    def __init__(
        self,
        journal: Journal,
        writer: Writer,
        persistence: Persistence,
        vision: VisionClient,
        calls: OperatorCalls,
        archive: PictureArchive,
        files: CallFiles,
        status: Path,
        stamp: Callable[[], float],
    ) -> None:
        """journal: only read before the daemon's first turn. stamp: gives seconds since 1970."""
        self._journal = journal
        self._writer = writer
        self._persistence = persistence
        self._vision = vision
        self._calls = calls
        self._archive = archive
        self._files = files
        self._status = status
        self._stamp = stamp
        self._drawing: dict[int, int] = {}
        """Id of a frame -> id of the call or hold for which it is drawn."""
        self._first_scene = 0, ""
        """Id of the frame that became the first reference, and the name of its picture until it is drawn."""
        self._frame_lost = False
        self._shown = 0, ""
        """Id of the newest call or hold, and the path of its picture for the ground, "" without one."""
        self._shown_frame: Assessment | None = None
        self._answers: tuple[int, list[Mapping[str, Any]]] = 0, []
        """Id of the newest call, and its answers."""
        self._frames = 0
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)

    @property
    def folder(self) -> Path:
        """Return the folder that contains all of it."""
        return self._status.parent

    def answered(self, reply: Reply) -> None:
        """Queue an answer that changed something: for the journal, and for its call's file."""
        at, target = self._stamp(), reply.acknowledgement.target
        record = self._persistence.save_answer(reply, at)
        if record is None:
            return
        entry = {"at": round(at, 2), **record}
        if target == self._answers[0]:
            self._answers[1].append(entry)
        self._writer.queue_job("record", partial(self._files.add_answer, target, entry))

    def call_opened(self, call: Call, state: State) -> None:
        """Write a new call's file, and have its frame stored and drawn."""
        self._answers = call.id, []
        if call.seen is None:
            return
        reasons = ", ".join(sorted(REASONS[reason.value] for reason in call.reasons))
        self._publish(call, call.seen, state, f"C{call.id} {reasons}")

    def call_judged_again(self, call: Call, state: State, title: str) -> None:
        """Write file and picture of a call that an answer left open, so that all show the same figures."""
        if call.seen is None:
            return
        if call.seen is self._shown_frame:
            self.draw(call.seen, state, title)
        else:
            self._publish(call, call.seen, state, title)

    def call_closed(self, call: Call) -> None:
        """Queue a closed call: for the journal, and for its file."""
        at = self._stamp()
        self._persistence.save_closed_call(call, at)
        told = replace(recorded(call), closed=at).document(("reasons", "outcome", "closed"))
        self._writer.queue_job("record", partial(self._files.close_record, call.id, told))

    def hold_shown(self, number: int, seen: Assessment, state: State) -> None:
        """Have the frame of a hold without a call stored and drawn."""
        self._store_and_draw(number, seen, state, f"H{number} blocked")

    def picture_of(self, number: int) -> str:
        """Return the path by which the ground reads the picture of a call or hold, "" without one."""
        return self._shown[1] if number == self._shown[0] else ""

    def draw(self, seen: Assessment, state: State, title: str) -> None:
        """Have a picture of a frame drawn for the archive."""
        if self._archive.wanted:
            self._vision.draw(seen.frame.id, title, state, roi=seen.roi)

    def first_scene(self, seen: Assessment, entry: Entry, state: State) -> None:
        """Have a picture of the first reference drawn, so that it can be shown when it matches."""
        if self._archive.wanted and self._vision.draw(seen.frame.id, "first place", state):
            self._first_scene = seen.frame.id, scene_name(entry)

    def drawn(self, drawn: Drawn) -> None:
        """Queue pictures that vision has drawn, and the PNG of the open call's frame for the journal."""
        number = self._drawing.pop(drawn.frame_id, 0) if drawn.stored else 0
        call = self._calls.call
        if number and drawn.png and call is not None and call.frame_id == drawn.frame_id:
            self._persistence.save_frame(drawn.frame_id, drawn.png)
        if drawn.panel and drawn.frame_id == self._first_scene[0]:
            names = {scene_name(entry) for entry in self._vision.memory.history if not entry.call_id}
            write_scene = partial(self._files.write_scene, self._first_scene[1], drawn.panel, names)
            self._writer.queue_job("picture", write_scene)
            self._first_scene = 0, ""
            if not number:
                return
        if not self._archive.wanted or not drawn.panel:
            if number == self._shown[0]:
                self._shown = number, ""
        elif number and number == self._shown[0] and drawn.thumbnail:
            write = partial(self._write_pictures, number, drawn, self._remembered())
            self._writer.queue_job("picture", write)
        else:
            self._writer.queue_job("picture", partial(self._archive.add, drawn.panel, drawn.title))

    def restore_call_frame(self) -> None:
        """Have the frame of a call that was open at the restart judged again, before the first turn."""
        call = self._calls.call
        if call is None:
            return
        png = self._load_frame(call)
        self._frame_lost = png is None or not self._vision.restore(_CALL_FRAME, call.frame_id, png)

    def forget_lost_frames(self) -> None:
        """Forget frames of the open call and the hold that vision has lost: answers cannot refer to them."""
        if self._vision.trouble:
            return
        holds = self._vision.has_stored_frame
        self._drawing = {frame: number for frame, number in self._drawing.items() if holds(frame)}
        call, hold = self._calls.call, self._calls.hold
        if call is not None and call.seen is not None and not holds(call.frame_id):
            call.seen, self._frame_lost = None, True
        if hold is not None and hold.seen is not None and not holds(hold.seen.frame.id):
            hold.seen = None

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether a `Done` is the outcome of a stored frame given to vision, and not of an answer."""
        return token is _CALL_FRAME or token is None

    def call_frame_judged(self, done: Done) -> None:
        """Take the assessment of the restored call's frame. Without one, the frame may be lost."""
        call, seen = self._calls.call, done.outcome.call if done.outcome is not None else None
        if call is None:
            return
        if seen is None:
            self._frame_lost = not self._vision.has_stored_frame(call.frame_id)
        elif seen.frame.id == call.frame_id:
            self._resume_call(call, seen)

    def replace_lost_frame(self, seen: Assessment) -> bool:
        """Make `seen` the frame of the open call, if the call's own frame is lost. Whether it did."""
        call = self._calls.call
        lost = self._frame_lost and call is not None and call.seen is None
        if not lost or self._vision.trouble or call is None or seen.observation is None:
            return False
        self._frame_lost = False
        call.frame_id = seen.frame.id
        self._resume_call(call, seen)
        return True

    def frame_judged(self, judged: FrameJudged) -> None:
        """Count a judged frame."""
        frame = judged.assessment.frame
        self._frames += 1
        self._recent.append((frame.id, frame.captured_at, judged.at))

    def write_status(self, figures: Mapping[str, Any]) -> dict[str, Any]:
        """Queue the status file: figures, number of judged frames, process id and the state of the disk.

        Return its content.
        """
        status = {**figures, "frames": self._frames, "pid": os.getpid(), "disk": self._writer.figures()}
        content = json.dumps(status).encode()
        # It is written again every second: a torn one lasts no longer.
        self._writer.queue_job("status", partial(write_atomically, self._status, content, sync=False))
        return status

    def leave(self, figures: Mapping[str, Any]) -> None:
        """Write everything that waits, within `SLOW` seconds, and last the status file.

        Only this last status file has the times of the newest frames, since that list is long and writing
        wears memory cards out.
        """
        self.write_status({**figures, "recent": list(self._recent)})
        self._writer.drain()

    def _load_frame(self, call: Call) -> bytes | None:
        try:
            self._answers = call.id, [*self._journal.answers(call.id)]
            return self._journal.load_frame(call.frame_id)
        except JournalError as error:
            log.warning("the frame of call %d is lost: %s", call.id, error)
            return None

    def _resume_call(self, call: Call, seen: Assessment) -> None:
        if call.seen is not None:
            return
        call.thing, call.seen = self._calls.reason_filter.things.asked(seen, frozenset(call.reasons))
        call.thing.call = call.id
        self._publish(call, seen, State.CALLING, f"C{call.id} after a restart")

    def _publish(self, call: Call, seen: Assessment, state: State, title: str) -> None:
        self._store_and_draw(call.id, seen, state, title)
        answers = list(self._answers[1]) if call.id == self._answers[0] else []
        told = replace(recorded(call), nearest=self._nearest(call.id, seen))
        figures = told.document((*FIGURES, "why", "nearest"))
        job = partial(self._files.begin_record, call.id, figures, answers, self._remembered())
        self._writer.queue_job("record", job)

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

    def _store_and_draw(self, number: int, seen: Assessment, state: State, title: str) -> None:
        accepted = self._vision.draw(seen.frame.id, title, state, store=True, roi=seen.roi)
        self._drawing[seen.frame.id] = number
        self._shown = number, address(f"{number}.jpg") if accepted and self._archive.wanted else ""
        self._shown_frame = seen

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
