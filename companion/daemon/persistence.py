"""What must survive, and what may be looked at later: journal, call's frame, album and status file."""

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
from companion.system.atomic_write import write_whole
from companion.vision.client import Applied, Vision
from companion.vision.messages import LARGEST_PNG, Drawn
from companion.wire.ids import State
from companion.wire.words_text import operation_text

log = logging.getLogger(__name__)

_CALL_FRAME = object()
_RECENT = 1200
_RESERVED = 4
_MOST_IDS = 0xFFFF

Say = Callable[[bool, float], None]
"""Says something once it is on disk, or could not be put there: whether it is, and monotonic seconds."""


class Persistence:
    """Hands what changed in a turn of the daemon to the writer, and knows what is on disk.

    Never waits: what must not be said before it is on disk is left here with `when_kept`.
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
        replies: AnswerStore,
        frame_id: int,
    ) -> None:
        """journal: read until the daemon's first turn. vision: draws. stamp: seconds since 1970.

        frame_id: of the last picture to tap in, over all restarts.
        """
        self._journal = journal
        self._writer = writer
        self._pictures_kept = pictures
        self._files = files
        self._status = status
        self._vision = vision
        self._drawing: dict[int, int] = {}
        """Frame -> the call or hold that it is drawn for."""
        self._news = Batch()
        """Of this turn."""
        self._unsaid: list[Say] = []
        self._waiting: deque[tuple[int, float, list[Say]]] = deque()
        self._ticket = 0
        self._memory: Memory | None = None
        self._memory_ticket, self._memory_at = 0, 0.0
        self._state: dict[str, Any] = {}
        self._last_id = 0
        self._frames = 0
        self._frame_id = frame_id
        self._replies = replies
        self._frame_lost = False
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)
        self._stamp = stamp
        self._shown = 0, ""
        """The call or hold that has a picture, and where the ground finds it."""
        self._shown_frame: Assessment | None = None
        self._answers: tuple[int, list[Mapping[str, Any]]] = 0, []
        """The newest call, and what was answered to it."""

    @property
    def folder(self) -> Path:
        """Where all of it is kept."""
        return self._status.parent

    @property
    def failing(self) -> bool:
        """Whether something that must survive could not be written at the last try, or waits for too long."""
        return self._writer.failing

    def save_memory(self, memory: Memory) -> None:
        """Have the algorithm's memory kept, with what else this turn brings."""
        if memory is not self._memory:
            self._memory = memory
            self._news = self._news.then(Batch(memory=memory))

    def settled(self, now: float, memory: Memory | None = None) -> bool:
        """Whether frames judged under the newest memory may let the vehicle drive on: it is on disk, or the
        disk did not take it in 2 s. memory: and whether it is this one.
        """
        if memory is not None and memory is not self._memory:
            return False
        return self._news.memory is None and self._kept(self._memory_ticket, self._memory_at, now) is not None

    def save_calls(self, calls: OperatorCalls, beside: Mapping[str, Any], now: float) -> None:
        """Have the open call, the hold, the counter, the replies and what stands `beside` them kept, in one
        transaction with all else that this turn brought; what did not change is not written again.

        With its reply in the journal an answer that comes again after a restart is known.
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
            "replies": self._replies.saved(),
        }
        if state != self._state:
            self._state = state
            self._keep(lambda: Batch(state=as_json(state)))
        if self._news:
            self._ticket = self._writer.keep(self._news)
            if self._news.memory is not None:
                self._memory_ticket, self._memory_at = self._ticket, now
            self._news = Batch()
        if self._unsaid:
            self._waiting.append((self._ticket, now, self._unsaid))
            self._unsaid = []

    def when_kept(self, say: Say) -> None:
        """Have `due` give `say` back once all that this turn brings is on disk, or was not taken in 2 s."""
        self._unsaid.append(say)

    def due(self, now: float) -> list[tuple[Say, bool]]:
        """What may be said now, in order, and whether it is on disk."""
        found: list[tuple[Say, bool]] = []
        while self._waiting:
            ticket, at, said = self._waiting[0]
            kept = self._kept(ticket, at, now)
            if kept is None:
                break
            self._waiting.popleft()
            found += [(say, kept) for say in said]
        return found

    def answered(self, reply: Reply) -> None:
        """Have an answer that changed something kept, and its reply."""
        request, acknowledgement = reply.request, reply.acknowledgement
        self._replies.add(request, acknowledgement)
        target = acknowledgement.target
        if target == 0:
            return
        record = {
            "motion": request.motion.name.lower(),
            "operations": [operation_text(operation) for operation in request.operations],
            "sender": list(request.sender),
            "result": acknowledgement.result.name.lower(),
            "text": acknowledgement.text,
        }
        at = self._stamp()
        self._keep(lambda: Batch(rows=(Row.of_answer(target, record, at),)))
        told = {"at": round(at, 2), **record}
        if target == self._answers[0]:
            self._answers[1].append(told)
        self._writer.write("record", partial(self._files.answered, target, told))

    def call_opened(self, call: Call, state: State) -> None:
        """Tell of it, and have its frame kept and drawn."""
        self._answers = call.id, []
        if call.seen is None:
            return
        reasons = " ".join(sorted(reason.value.replace("_", " ") for reason in call.reasons))
        self._tell(call, call.seen, state, f"C{call.id} {reasons}")

    def call_judged_again(self, call: Call, state: State, title: str) -> None:
        """An answer left the call open: text, file and picture name the same figures again."""
        if call.seen is None:
            return
        if call.seen is self._shown_frame:
            self.picture(call.seen, state, title)
        else:
            self._tell(call, call.seen, state, title)

    def call_closed(self, call: Call) -> None:
        """Nothing is asked any more."""
        at = self._stamp()
        self._keep(lambda: Batch(rows=(Row.of_call(call, at),)))
        reasons = sorted(reason.value for reason in call.reasons)
        self._writer.write(
            "record", partial(self._files.closed, call.id, reasons, call.outcome.name.lower(), at)
        )

    def hold_shown(self, number: int, seen: Assessment, state: State) -> None:
        """Keep a picture of what blocks the way."""
        self._show(number, seen, state, f"H{number} blocked")

    def picture_of(self, number: int) -> str:
        """Where the ground finds the picture of an open call or hold, "" without one."""
        return self._shown[1] if number == self._shown[0] else ""

    def picture(self, seen: Assessment, state: State, title: str) -> None:
        """A moment for the album."""
        if self._pictures_kept.wanted:
            self._vision.draw(seen.frame.id, title, state)

    def drawn(self, drawn: Drawn, calls: OperatorCalls) -> None:
        """Pictures came: have them written, and what must survive of an open call."""
        number = self._drawing.pop(drawn.frame_id, 0) if drawn.kept else 0
        if number and drawn.png and calls.call is not None and calls.call.frame_id == drawn.frame_id:
            self._keep_frame(drawn.frame_id, drawn.png)
        if not self._pictures_kept.wanted or not drawn.panel:
            if number == self._shown[0]:
                self._shown = number, ""
        elif number and number == self._shown[0] and drawn.thumbnail:
            store = partial(self._store, number, drawn.thumbnail, drawn.panel, drawn.title)
            self._writer.write("picture", store)
        else:
            self._writer.write("picture", partial(self._pictures_kept.add, drawn.panel, drawn.title))

    def judged(self, seen: Assessment, at: float) -> None:
        """Count a judged frame."""
        self._frames += 1
        self._recent.append((seen.frame.id, seen.frame.captured_at, at))

    def restore_call_frame(self, calls: OperatorCalls) -> None:
        """Have the frame of a call that a restart found open judged again. Before the daemon's first turn."""
        if calls.call is None:
            return
        png = self._restored(calls.call)
        self._frame_lost = png is None or not self._vision.restore(_CALL_FRAME, calls.call.frame_id, png)

    def miss_frames(self, calls: OperatorCalls) -> None:
        """What vision does not hold cannot be answered: the open call and the hold get another frame."""
        if self._vision.trouble:
            return
        holds = self._vision.holds_frame
        self._drawing = {frame: number for frame, number in self._drawing.items() if holds(frame)}
        call, hold = calls.call, calls.hold
        if call is not None and call.seen is not None and not holds(call.frame_id):
            call.seen, self._frame_lost = None, True
        if hold is not None and hold.seen is not None and not holds(hold.seen.frame.id):
            hold.seen = None

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether an `Applied` belongs to `restore_call_frame`, or to a frame given back to a new vision."""
        return token is _CALL_FRAME or token is None

    def reseen(self, calls: OperatorCalls, applied: Applied, now: float) -> None:
        """The frame of the restored call has been judged, or could not be; a new vision may try again."""
        call, seen = calls.call, applied.outcome.call if applied.outcome is not None else None
        if call is None:
            return
        if seen is None:
            self._frame_lost = not self._vision.holds_frame(call.frame_id)
        elif seen.frame.id == call.frame_id:
            self._take_up(calls, seen, now)

    def replace_lost_frame(self, calls: OperatorCalls, seen: Assessment, now: float) -> bool:
        """Whether `seen` took the place of the restored call's frame, because that one is lost."""
        lost = self._frame_lost and calls.call is not None and calls.call.seen is None
        if not lost or self._vision.trouble or calls.call is None or seen.observation is None:
            return False
        self._frame_lost = False
        calls.call.frame_id = seen.frame.id
        self._take_up(calls, seen, now)
        return True

    def write_status(self, figures: Mapping[str, Any]) -> None:
        """The status file: figures, frames judged, whose they are, and how the disk does."""
        self._writer.write("status", partial(write_whole, self._status, self._whole(figures)))

    def leave(self, figures: Mapping[str, Any]) -> None:
        """The last word: all that waits is written, as far as the disk takes it in 2 s, the status file last,
        with when the newest frames were taken and judged; that list is long, and memory cards wear out.
        """
        if self._state:
            self._writer.keep(Batch(state=as_json({**self._state, "last_id": self._last_id})))
        self.write_status({**figures, "recent": list(self._recent)})
        self._writer.drain()

    def _whole(self, figures: Mapping[str, Any]) -> bytes:
        writer = self._writer
        disk = {"failing": writer.failing, "errors": dict(writer.errors), "dropped": dict(writer.dropped)}
        return json.dumps({**figures, "frames": self._frames, "pid": os.getpid(), "disk": disk}).encode()

    def _kept(self, ticket: int, at: float, now: float) -> bool | None:
        """Whether what was handed over at `at` is on disk, None while that is open."""
        if self._writer.committed >= ticket:
            return True
        return False if self._writer.failed >= ticket or now - at >= SLOW else None

    def _keep(self, made: Callable[[], Batch]) -> None:
        try:
            self._news = self._news.then(made())
        except JournalError as error:
            log.error("not kept: %s", error)

    def _keep_frame(self, frame_id: int, png: bytes) -> None:
        if len(png) > LARGEST_PNG:
            log.error("the frame of the call is not kept: %d bytes, at most %d", len(png), LARGEST_PNG)
            return
        self._news = self._news.then(Batch(frame=(frame_id, png)))

    def _restored(self, call: Call) -> bytes | None:
        try:
            self._answers = call.id, [*self._journal.answers(call.id)]
            return self._journal.load_frame(call.frame_id)
        except JournalError as error:
            log.warning("the frame of call %d is lost: %s", call.id, error)
            return None

    def _take_up(self, calls: OperatorCalls, seen: Assessment, now: float) -> None:
        call = calls.call
        if call is None or call.seen is not None:
            return
        call.seen = seen
        call.scope = Acceptance.of(
            seen, frozenset(call.reasons), calls.numbers, now, calls.autopilot.travelled
        )
        self._tell(call, seen, State.CALLING, f"C{call.id} after a restart")

    def _tell(self, call: Call, seen: Assessment, state: State, title: str) -> None:
        self._show(call.id, seen, state, title)
        answers = list(self._answers[1]) if call.id == self._answers[0] else []
        self._writer.write("record", partial(self._files.opened, call.id, record_of(call), answers))

    def _show(self, number: int, seen: Assessment, state: State, title: str) -> None:
        asked = self._vision.draw(seen.frame.id, title, state, keep=True)
        self._drawing[seen.frame.id] = number
        self._shown = number, address(f"{number}.jpg") if asked and self._pictures_kept.wanted else ""
        self._shown_frame = seen

    def _store(self, number: int, small: bytes, large: bytes, title: str) -> None:
        """In the writer's thread."""
        try:
            self._files.pictures(number, small, self._pictures_kept.add(large, title))
        except Exception:
            if self._shown[0] == number:
                self._shown = number, ""
            raise


def _reserved(last_id: int) -> int:
    """The journal's counter runs ahead, so that an id may be told before it is on disk: after a kill those
    between are skipped, and none is given twice.
    """
    ahead = (last_id // _RESERVED + 2) * _RESERVED
    return ahead if ahead <= _MOST_IDS else ahead - _MOST_IDS
