"""What must survive, and what may be looked at later: journal, call's frame, album and status file."""

from __future__ import annotations

import json
import logging
import os
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.memory import Memory
from companion.album import Album
from companion.calls.acceptance import Acceptance
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import snapshot
from companion.conversation import Reply
from companion.durable import write_whole
from companion.files.calls import CallFiles
from companion.journal import Journal, JournalError
from companion.kept import Kept, kept_reply
from companion.vision.client import Applied, Vision
from companion.vision.messages import Drawn
from companion.wire.ids import State
from companion.wire.words_text import operation_text

log = logging.getLogger(__name__)

_CALL_FRAME = object()
_NOTHING: Mapping[str, Any] = MappingProxyType({})
_RECENT = 1200
_REPLIES = 16
_PATIENCE = 0.5
"""Seconds before what could not be written is tried again."""
_MOST_OWED = 16
_Owed = tuple[str, Callable[[Any], None], Any]


class Keeper:
    """Writes what changed; `failing` when it cannot. The daemon goes on unremembered."""

    def __init__(
        self,
        journal: Journal,
        album: Album,
        files: CallFiles,
        vision: Vision,
        status: Path,
        frame_id: int = 0,
        replies: Sequence[Kept] = (),
    ) -> None:
        """frame_id: of the last picture to tap in, over all restarts. replies: those kept before it."""
        self._journal = journal
        self._album = album
        self._files = files
        self._vision = vision
        self._drawing: dict[int, int] = {}
        """Frame -> the call or hold that it is drawn for."""
        self._status = status
        self._memory: Memory | None = None
        self._calls: dict[str, Any] | None = None
        self._failed_at: dict[str, float] = {}
        self._owed: list[_Owed] = []
        self._frames = 0
        self._frame_id = frame_id
        self._replies: deque[Kept] = deque(replies, _REPLIES)
        self._frame_lost = False
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)
        self.stamp: Callable[[], float] = time.time
        """Asked for the time that calls and answers get, seconds since 1970."""
        self._shown = 0, ""
        """The call or hold that has a picture, and where the ground finds it."""

    @property
    def folder(self) -> Path:
        """Where all of it is kept."""
        return self._status.parent

    @property
    def failing(self) -> bool:
        """Whether something that must survive could not be written at the last try."""
        return bool(self._failed_at)

    def save_memory(self, memory: Memory) -> bool:
        """Whether the journal holds `memory`."""
        if memory is not self._memory and self._write("memory", self._journal.save_memory, memory):
            self._memory = memory
        return memory is self._memory

    def save_calls(
        self, calls: OperatorCalls, replies: Sequence[Reply] = (), beside: Mapping[str, Any] = _NOTHING
    ) -> bool:
        """Whether the journal holds the open call, the hold, the counter, `replies` and what stands `beside`
        them, all or nothing.

        With its reply in the journal an answer that comes again after a restart is known.
        """
        self._pay()
        for reply in replies:
            if not reply.again:
                self._answered(reply)
        state = {**snapshot(calls), **beside}
        asked = calls.call.frame_id if calls.call else 0
        shown = calls.hold.seen.frame.id if calls.hold and calls.hold.seen else 0
        self._frame_id = max(self._frame_id, asked, shown)
        state["frame_id"] = self._frame_id
        state["replies"] = [kept.saved() for kept in self._replies]
        if state != self._calls and self._write("calls", self._journal.save_supervision, state):
            self._calls = state
        return state == self._calls

    def call_opened(self, call: Call, state: State) -> None:
        """Tell of it, and have its frame kept and drawn."""
        reasons = " ".join(sorted(reason.value.replace("_", " ") for reason in call.reasons))
        self._show(call, state, f"C{call.id} {reasons}")

    def call_closed(self, call: Call) -> None:
        """Nothing is asked any more."""
        at = self.stamp()
        self._keep("call", partial(self._journal.record_call, at=at), call)
        self._files.closed(call, at)

    def hold_shown(self, number: int, seen: Assessment, state: State) -> None:
        """Keep a picture of what blocks the way."""
        self._draw(number, seen.frame.id, f"H{number} blocked", state)

    def drawn(self, drawn: Drawn, calls: OperatorCalls) -> None:
        """Pictures came: write them, and what must survive of an open call."""
        number = self._drawing.pop(drawn.frame_id, 0) if drawn.png else 0
        if number and calls.call is not None and calls.call.frame_id == drawn.frame_id:
            self._keep("frame", self._journal.save_frame, drawn.png)
        large = self._album.store(drawn.title, drawn.panel)
        if number and large is not None:
            self._shown = number, self._files.drawn(number, drawn.thumbnail, large)

    def picture_of(self, number: int) -> str:
        """Where the ground finds the picture of an open call or hold, "" without one."""
        return self._shown[1] if number == self._shown[0] else ""

    def picture(self, seen: Assessment, state: State, title: str) -> None:
        """A moment for the album."""
        if self._album.wanted:
            self._vision.draw(seen.frame.id, title, state)

    def judged(self, seen: Assessment, at: float) -> None:
        """Count a judged frame."""
        self._frames += 1
        self._recent.append((seen.frame.id, seen.frame.captured_at, at))

    def restore_call_frame(self, calls: OperatorCalls) -> None:
        """Have the frame of a call that a restart found open judged again."""
        if calls.call is None:
            return
        png = self._journal.load_frame()
        self._frame_lost = png is None or not self._vision.restore(_CALL_FRAME, calls.call.frame_id, png)

    def lost_vision(self, calls: OperatorCalls) -> None:
        """The vision process died: a call whose frame had not come from it yet gets another one."""
        self._drawing.clear()
        if calls.call is not None and not self._vision.holds_frame(calls.call.frame_id):
            calls.call.seen, self._frame_lost = None, True

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether an `Applied` belongs to `restore_call_frame`."""
        return token is _CALL_FRAME

    def reseen(self, calls: OperatorCalls, applied: Applied, now: float) -> None:
        """The frame of the restored call has been judged, or could not be."""
        if applied.outcome is None or applied.outcome.call is None:
            self._frame_lost = True
        else:
            self._take_up(calls, applied.outcome.call, now)

    def replace_lost_frame(self, calls: OperatorCalls, seen: Assessment, now: float) -> bool:
        """Whether `seen` took the place of the restored call's frame, because that one is lost."""
        lost = self._frame_lost and calls.call is not None and calls.call.seen is None
        if not lost or calls.call is None or seen.observation is None:
            return False
        self._frame_lost = False
        calls.call.frame_id = seen.frame.id
        self._take_up(calls, seen, now)
        return True

    def _take_up(self, calls: OperatorCalls, seen: Assessment, now: float) -> None:
        call = calls.call
        if call is None or call.seen is not None:
            return
        call.seen = seen
        call.scope = Acceptance.of(
            seen, frozenset(call.reasons), calls.numbers, now, calls.autopilot.travelled
        )
        self._show(call, State.CALLING, f"C{call.id} after a restart")

    def _show(self, call: Call, state: State, title: str) -> None:
        self._files.opened(call, self._answers(call))
        self._draw(call.id, call.frame_id, title, state)

    def _draw(self, number: int, frame_id: int, title: str, state: State) -> None:
        self._drawing[frame_id] = number
        self._vision.draw(frame_id, title, state, keep=True)

    def _answers(self, call: Call) -> Sequence[Mapping[str, Any]]:
        try:
            return self._journal.answers(call.id)
        except JournalError as error:
            log.warning("earlier answers to call %d are not told: %s", call.id, error)
            return ()

    def write_status(self, figures: Mapping[str, Any], *, last: bool = False) -> None:
        """The status file: figures, frames judged, and whose they are.

        last: with when the newest frames were taken and judged; that list is long, and memory cards wear out.
        """
        status = {**figures, "frames": self._frames, "pid": os.getpid()}
        if last:
            status["recent"] = list(self._recent)
        try:
            write_whole(self._status, json.dumps(status).encode())
        except OSError as error:
            log.warning("no status file: %s", error)

    def _answered(self, reply: Reply) -> None:
        request, acknowledgement = reply.request, reply.acknowledgement
        kept = kept_reply(request, acknowledgement)
        if kept is not None:
            self._replies.append(kept)
        if acknowledgement.target == 0:
            return
        record = {
            "motion": request.motion.name.lower(),
            "operations": [operation_text(operation) for operation in request.operations],
            "sender": list(request.sender),
            "result": acknowledgement.result.name.lower(),
            "text": acknowledgement.text,
        }
        at = self.stamp()
        self._keep("answer", partial(self._journal.record_answer, acknowledgement.target, at=at), record)
        self._files.answered(acknowledgement.target, {"at": round(at, 2), **record})

    def _keep(self, what: str, write: Callable[[Any], None], value: Any) -> None:
        """Now, or when there is room; of several frames the newest."""
        owed = [one for one in self._owed if one[0] != "frame" or what != "frame"]
        self._owed = [*owed, (what, write, value)][-_MOST_OWED:]
        self._pay()

    def _pay(self) -> None:
        """What fails in a way that nobody foresaw is not tried again: it would fail in every turn."""
        owed, self._owed = self._owed, []
        self._owed = [one for one in owed if not self._write(*one)]

    def _write(self, what: str, write: Callable[[Any], None], value: Any) -> bool:
        now = time.monotonic()
        failed_at = self._failed_at.get(what)
        if failed_at is not None and now - failed_at < _PATIENCE:
            return False
        try:
            write(value)
        except JournalError as error:
            if failed_at is None:
                log.error("%s not kept: %s", what, error)
            self._failed_at[what] = now
            return False
        self._failed_at.pop(what, None)
        return True
