"""Queues for the writer what must survive a restart, and what may be read later: pictures, files, status."""

from __future__ import annotations

import json
import logging
import os
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.memory import Memory
from companion.answers.handler import Reply
from companion.answers.store import AnswerStore
from companion.calls.acceptance import Acceptance
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import snapshot
from companion.storage import Batch, Journal, JournalError, Row
from companion.storage.batch import as_json, record_of
from companion.storage.call_files import CallFiles, PictureArchive, address
from companion.storage.writer import SLOW, Writer
from companion.system.atomic_write import write_atomically
from companion.vision.client import Applied, Vision
from companion.vision.messages import LARGEST_PNG, Drawn
from companion.wire.ids import State
from companion.wire.words_text import operation_text

log = logging.getLogger(__name__)

_CALL_FRAME = object()
_RECENT = 1200
"""Newest frames whose times are written to the last status file."""
_RESERVED = 4
"""Ids that the journal's counter is raised by at a time."""
_MOST_IDS = 0xFFFF

Say = Callable[[bool, float], None]
"""Called with whether a turn's changes are on disk, once that is known, and with monotonic seconds."""


class Persistence:
    """Collects the changes of a turn of the main loop for the writer, and knows which are on disk.

    Never waits: a message that must not be sent before a change is on disk is registered with `after_write`.
    """

    def __init__(
        self,
        journal: Journal,
        writer: Writer,
        pictures: PictureArchive,
        files: CallFiles,
        vision: Vision,
        status: Path,
        stamp: Callable[[], float],
        answers: AnswerStore,
        frame_id: int,
    ) -> None:
        """journal: only read before the daemon's first turn. stamp: gives seconds since 1970.

        frame_id: the newest id of a call's or hold's frame, over all restarts: ids must not be used twice.
        """
        self._journal = journal
        self._writer = writer
        self._archive = pictures
        self._files = files
        self._status = status
        self._vision = vision
        self._drawing: dict[int, int] = {}
        """Id of a frame -> id of the call or hold for which it is drawn."""
        self._changes = Batch()
        """The changes of this turn."""
        self._unsent: list[Say] = []
        self._waiting: deque[tuple[int, float, list[Say]]] = deque()
        self._ticket = 0
        self._memory: Memory | None = None
        self._memory_ticket, self._memory_at = 0, 0.0
        self._state: dict[str, Any] = {}
        self._last_id = 0
        self._frames = 0
        self._frame_id = frame_id
        self._answer_store = answers
        self._frame_lost = False
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)
        self._stamp = stamp
        self._shown = 0, ""
        """Id of the newest call or hold, and the path of its picture for the ground, "" without one."""
        self._shown_frame: Assessment | None = None
        self._answers: tuple[int, list[Mapping[str, Any]]] = 0, []
        """Id of the newest call, and its answers."""

    @property
    def folder(self) -> Path:
        """Return the folder that contains all of it."""
        return self._status.parent

    @property
    def failing(self) -> bool:
        """Whether the last write to the journal failed, or the disk is slow."""
        return self._writer.failing

    def save_memory(self, memory: Memory) -> None:
        """Queue the algorithm's memory, with the other changes of this turn."""
        if memory is not self._memory:
            self._memory = memory
            self._changes = self._changes.then(Batch(memory=memory))

    def memory_stored(self, now: float, memory: Memory | None = None) -> bool:
        """Whether frames judged by the newest memory may let the vehicle drive on.

        They may once that memory is on disk. They may, too, when it could not be written within `SLOW`
        seconds: a full disk alone must not hold the vehicle for ever.
        memory: the one by which a frame was judged; False when it is not the newest.
        """
        if memory is not None and memory is not self._memory:
            return False
        return (
            self._changes.memory is None
            and self._is_on_disk(self._memory_ticket, self._memory_at, now) is not None
        )

    def save_calls(self, calls: OperatorCalls, beside: Mapping[str, Any], now: float) -> None:
        """Queue the open call, the hold, the counter of ids, the replies and `beside`, if they changed.

        All changes of the turn go into one transaction. The replies are in it, so that an answer that is sent
        again after a restart is recognised.
        """
        asked = calls.call.frame_id if calls.call else 0
        shown = calls.hold.seen.frame.id if calls.hold and calls.hold.seen else 0
        self._frame_id = max(self._frame_id, asked, shown)
        self._last_id = calls.last_id
        state = {
            **snapshot(calls),
            **beside,
            "last_id": _reserved(calls.last_id),
            "frame_id": self._frame_id,
            "replies": self._answer_store.saved(),
        }
        if state != self._state:
            # The writer always holds the whole state, so that of several waiting states the newest suffices.
            self._state = state
            self._queue(lambda: Batch(state=as_json(state)))
        if self._changes:
            self._ticket = self._writer.keep(self._changes)
            if self._changes.memory is not None:
                self._memory_ticket, self._memory_at = self._ticket, now
            self._changes = Batch()
        if self._unsent:
            self._waiting.append((self._ticket, now, self._unsent))
            self._unsent = []

    def after_write(self, say: Say) -> None:
        """Make `due` return `say` once this turn's changes are on disk, or were not written in `SLOW` s."""
        self._unsent.append(say)

    def due(self, now: float) -> list[tuple[Say, bool]]:
        """Return what may be sent now, in order, and whether its turn's changes are on disk."""
        found: list[tuple[Say, bool]] = []
        while self._waiting:
            ticket, at, said = self._waiting[0]
            kept = self._is_on_disk(ticket, at, now)
            if kept is None:
                break
            self._waiting.popleft()
            found += [(say, kept) for say in said]
        return found

    def answered(self, reply: Reply) -> None:
        """Queue an answer that changed something, and its reply."""
        answer, acknowledgement = reply.answer, reply.acknowledgement
        self._answer_store.save(answer, acknowledgement)
        target = acknowledgement.target
        if target == 0:
            return
        record = {
            "motion": answer.motion.name.lower(),
            "operations": [operation_text(operation) for operation in answer.operations],
            "sender": list(answer.sender),
            "result": acknowledgement.result.name.lower(),
            "text": acknowledgement.text,
        }
        at = self._stamp()
        self._queue(lambda: Batch(rows=(Row.of_answer(target, record, at),)))
        entry = {"at": round(at, 2), **record}
        if target == self._answers[0]:
            self._answers[1].append(entry)
        self._writer.write("record", partial(self._files.answered, target, entry))

    def call_opened(self, call: Call, state: State) -> None:
        """Write a new call's file, and have its frame stored and drawn."""
        self._answers = call.id, []
        if call.seen is None:
            return
        reasons = " ".join(sorted(reason.value.replace("_", " ") for reason in call.reasons))
        self._publish(call, call.seen, state, f"C{call.id} {reasons}")

    def call_judged_again(self, call: Call, state: State, title: str) -> None:
        """Write file and picture of a call that an answer left open, so that all show the same figures."""
        if call.seen is None:
            return
        if call.seen is self._shown_frame:
            self.picture(call.seen, state, title)
        else:
            self._publish(call, call.seen, state, title)

    def call_closed(self, call: Call) -> None:
        """Queue a closed call's record and its file."""
        at = self._stamp()
        self._queue(lambda: Batch(rows=(Row.of_call(call, at),)))
        reasons = sorted(reason.value for reason in call.reasons)
        self._writer.write(
            "record", partial(self._files.closed, call.id, reasons, call.outcome.name.lower(), at)
        )

    def hold_shown(self, number: int, seen: Assessment, state: State) -> None:
        """Have the frame of a hold without a call stored and drawn."""
        self._draw(number, seen, state, f"H{number} blocked")

    def picture_of(self, number: int) -> str:
        """Return the path by which the ground reads the picture of a call or hold, "" without one."""
        return self._shown[1] if number == self._shown[0] else ""

    def picture(self, seen: Assessment, state: State, title: str) -> None:
        """Have a picture of a frame drawn for the archive."""
        if self._archive.wanted:
            self._vision.draw(seen.frame.id, title, state)

    def drawn(self, drawn: Drawn, calls: OperatorCalls) -> None:
        """Queue pictures that vision has drawn, and the PNG of the open call's frame for the journal."""
        number = self._drawing.pop(drawn.frame_id, 0) if drawn.kept else 0
        if number and drawn.png and calls.call is not None and calls.call.frame_id == drawn.frame_id:
            self._queue_frame(drawn.frame_id, drawn.png)
        if not self._archive.wanted or not drawn.panel:
            if number == self._shown[0]:
                self._shown = number, ""
        elif number and number == self._shown[0] and drawn.thumbnail:
            store = partial(self._write_pictures, number, drawn.thumbnail, drawn.panel, drawn.title)
            self._writer.write("picture", store)
        else:
            self._writer.write("picture", partial(self._archive.add, drawn.panel, drawn.title))

    def judged(self, seen: Assessment, at: float) -> None:
        """Count a judged frame. at: monotonic seconds when judging ended."""
        self._frames += 1
        self._recent.append((seen.frame.id, seen.frame.captured_at, at))

    def restore_call_frame(self, calls: OperatorCalls) -> None:
        """Have the frame of a call that was open at the restart judged again, before the first turn."""
        if calls.call is None:
            return
        png = self._load_frame(calls.call)
        self._frame_lost = png is None or not self._vision.restore(_CALL_FRAME, calls.call.frame_id, png)

    def forget_lost_frames(self, calls: OperatorCalls) -> None:
        """Forget frames of the open call and the hold that vision has lost: answers cannot refer to them."""
        if self._vision.trouble:
            return
        holds = self._vision.has_stored_frame
        self._drawing = {frame: number for frame, number in self._drawing.items() if holds(frame)}
        call, hold = calls.call, calls.hold
        if call is not None and call.seen is not None and not holds(call.frame_id):
            call.seen, self._frame_lost = None, True
        if hold is not None and hold.seen is not None and not holds(hold.seen.frame.id):
            hold.seen = None

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether an `Applied` is the outcome of a stored frame given to vision, and not of an answer."""
        return token is _CALL_FRAME or token is None

    def call_frame_judged(self, calls: OperatorCalls, applied: Applied, now: float) -> None:
        """Take the assessment of the restored call's frame. Without one, the frame may be lost."""
        call, seen = calls.call, applied.outcome.call if applied.outcome is not None else None
        if call is None:
            return
        if seen is None:
            self._frame_lost = not self._vision.has_stored_frame(call.frame_id)
        elif seen.frame.id == call.frame_id:
            self._resume_call(calls, seen, now)

    def replace_lost_frame(self, calls: OperatorCalls, seen: Assessment, now: float) -> bool:
        """Make `seen` the frame of the open call, if the call's own frame is lost. Whether it did."""
        lost = self._frame_lost and calls.call is not None and calls.call.seen is None
        if not lost or self._vision.trouble or calls.call is None or seen.observation is None:
            return False
        self._frame_lost = False
        calls.call.frame_id = seen.frame.id
        self._resume_call(calls, seen, now)
        return True

    def write_status(self, figures: Mapping[str, Any]) -> None:
        """Queue the status file: figures, number of judged frames, process id and the state of the disk."""
        # It is written again every second: a torn one lasts no longer.
        content = self._status_bytes(figures)
        self._writer.write("status", partial(write_atomically, self._status, content, sync=False))

    def leave(self, figures: Mapping[str, Any]) -> None:
        """Write everything that waits, within `SLOW` seconds, and last the status file.

        Only this last status file has the times of the newest frames, since that list is long and writing
        wears memory cards out.
        """
        # Nothing more will be sent, so that no ids need to be reserved: the next start goes on with the next.
        if self._state:
            self._writer.keep(Batch(state=as_json({**self._state, "last_id": self._last_id})))
        self.write_status({**figures, "recent": list(self._recent)})
        self._writer.drain()

    def _status_bytes(self, figures: Mapping[str, Any]) -> bytes:
        writer = self._writer
        disk = {"failing": writer.failing, "errors": dict(writer.errors), "dropped": dict(writer.dropped)}
        return json.dumps({**figures, "frames": self._frames, "pid": os.getpid(), "disk": disk}).encode()

    def _is_on_disk(self, ticket: int, at: float, now: float) -> bool | None:
        """Whether what was queued at `at` is on disk; None while that is not known."""
        if self._writer.committed >= ticket:
            return True
        return False if self._writer.failed >= ticket or now - at >= SLOW else None

    def _queue(self, made: Callable[[], Batch]) -> None:
        try:
            self._changes = self._changes.then(made())
        except JournalError as error:
            log.error("not stored: %s", error)

    def _queue_frame(self, frame_id: int, png: bytes) -> None:
        if len(png) > LARGEST_PNG:
            log.error(
                "the frame of the call is not stored: %d bytes, at most %d: set a smaller picture",
                len(png),
                LARGEST_PNG,
            )
            return
        self._changes = self._changes.then(Batch(frame=(frame_id, png)))

    def _load_frame(self, call: Call) -> bytes | None:
        try:
            self._answers = call.id, [*self._journal.answers(call.id)]
            return self._journal.load_frame(call.frame_id)
        except JournalError as error:
            log.warning("the frame of call %d is lost: %s", call.id, error)
            return None

    def _resume_call(self, calls: OperatorCalls, seen: Assessment, now: float) -> None:
        call = calls.call
        if call is None or call.seen is not None:
            return
        call.seen = seen
        call.scope = Acceptance.of(
            seen, frozenset(call.reasons), calls.numbers, now, calls.vehicle_mode.travelled
        )
        self._publish(call, seen, State.CALLING, f"C{call.id} after a restart")

    def _publish(self, call: Call, seen: Assessment, state: State, title: str) -> None:
        self._draw(call.id, seen, state, title)
        answers = list(self._answers[1]) if call.id == self._answers[0] else []
        self._writer.write("record", partial(self._files.opened, call.id, record_of(call), answers))

    def _draw(self, number: int, seen: Assessment, state: State, title: str) -> None:
        asked = self._vision.draw(seen.frame.id, title, state, keep=True)
        self._drawing[seen.frame.id] = number
        self._shown = number, address(f"{number}.jpg") if asked and self._archive.wanted else ""
        self._shown_frame = seen

    def _write_pictures(self, number: int, small: bytes, large: bytes, title: str) -> None:
        """Write the pictures of a call or hold. Runs in the writer's thread."""
        try:
            self._files.pictures(number, small, self._archive.add(large, title))
        except Exception:
            if self._shown[0] == number:
                self._shown = number, ""
            raise


def _reserved(last_id: int) -> int:
    """Return the counter of ids as it is stored: ahead of `last_id`, by up to two blocks of `_RESERVED`.

    So an id may be sent before it is on disk. After a kill the ids between are skipped; none is used twice.
    """
    ahead = (last_id // _RESERVED + 2) * _RESERVED
    return ahead if ahead <= _MOST_IDS else ahead - _MOST_IDS
