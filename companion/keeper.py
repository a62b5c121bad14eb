"""What must survive, and what may be looked at later: journal, call's frame, album and status file."""

from __future__ import annotations

import json
import logging
import os
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.frame import Frame
from anytraverse.memory import Memory
from companion.album import Album
from companion.calls.acceptance import Acceptance
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import snapshot
from companion.conversation import Reply
from companion.eyes import Applied, Eyes
from companion.journal import Journal, JournalError
from companion.wire.ids import State

log = logging.getLogger(__name__)

_CALL_FRAME = object()
_LONGEST_NAME = 60
_RECENT = 1200


class Keeper:
    """Writes what changed, and says once when it cannot; the daemon goes on unremembered."""

    def __init__(self, journal: Journal, album: Album, status: Path, frame_id: int = 0) -> None:
        """frame_id: of the last call, over all restarts."""
        self._journal = journal
        self._album = album
        self._status = status
        self._memory: Memory | None = None
        self._calls: dict[str, Any] | None = None
        self._failing = False
        self._frames = 0
        self._frame_id = frame_id
        self._recent: deque[tuple[int, float, float]] = deque(maxlen=_RECENT)
        self.call_picture = ""
        """Name of the open call's picture, or its path where that is short enough for the wire."""

    def save_memory(self, memory: Memory) -> bool:
        """Whether the journal holds `memory`."""
        if memory is not self._memory and self._write("memory", self._journal.save_memory, memory):
            self._memory = memory
        return memory is self._memory

    def save_calls(self, calls: OperatorCalls) -> bool:
        """Whether the journal holds the open call, the hold and the counter as they are."""
        state = snapshot(calls)
        self._frame_id = max(self._frame_id, calls.call.frame_id if calls.call else 0)
        state["frame_id"] = self._frame_id
        if state != self._calls and self._write("calls", self._journal.save_supervision, state):
            self._calls = state
        return state == self._calls

    def call_opened(self, call: Call, state: State) -> None:
        """Keep the call's frame, and a picture of it."""
        if call.seen is None:
            return
        self._write("frame", self._journal.save_frame, call.seen.frame.image)
        reasons = " ".join(sorted(reason.value.replace("_", " ") for reason in call.reasons))
        self.call_picture = self._wire_name(self._album.keep(call.seen, state, f"C{call.id} {reasons}"))

    def call_closed(self, call: Call) -> None:
        """Nothing is asked any more."""
        self._write("call", self._journal.record_call, call)
        self.call_picture = ""

    def answered(self, reply: Reply) -> None:
        """Keep what was answered to a call, and what came of it."""
        request, acknowledgement = reply.request, reply.acknowledgement
        if acknowledgement.target == 0:
            return
        record = {
            "motion": request.motion.name.lower(),
            "operations": [str(operation) for operation in request.operations],
            "sender": list(request.sender),
            "result": acknowledgement.result.name.lower(),
            "text": acknowledgement.text,
        }
        self._write("answer", partial(self._journal.record_answer, acknowledgement.target), record)

    def picture(self, seen: Assessment, state: State, title: str) -> None:
        """A moment for the album."""
        self._album.keep(seen, state, title)

    def judged(self, seen: Assessment, at: float) -> None:
        """Count a judged frame."""
        self._frames += 1
        self._recent.append((seen.frame.id, seen.frame.captured_at, at))

    def restore_call_frame(self, calls: OperatorCalls, eyes: Eyes) -> None:
        """Have the frame of a call that a restart found open judged again."""
        image = self._journal.load_frame() if calls.call is not None else None
        if calls.call is not None and image is not None:
            eyes.look_at(_CALL_FRAME, Frame(calls.call.frame_id, time.monotonic(), image))

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether an `Applied` belongs to `restore_call_frame`."""
        return token is _CALL_FRAME

    def reseen(self, calls: OperatorCalls, applied: Applied, now: float) -> None:
        """The frame of the restored call has been judged."""
        call, outcome = calls.call, applied.outcome
        if call is None or call.seen is not None or outcome is None or outcome.call is None:
            return
        call.seen = outcome.call
        call.scope = Acceptance.of(
            outcome.call, frozenset(call.reasons), calls.numbers, now, calls.autopilot.travelled
        )
        picture = self._album.keep(outcome.call, State.CALLING, f"C{call.id} after a restart")
        self.call_picture = self._wire_name(picture)

    def write_status(self, figures: Mapping[str, Any]) -> None:
        """The status file: figures, frames judged, and when the newest frames were taken and judged."""
        status = {**figures, "frames": self._frames, "recent": list(self._recent)}
        torn = self._status.with_suffix(".part")
        try:
            torn.write_text(json.dumps(status), encoding="utf-8")
            os.replace(torn, self._status)
        except OSError as error:
            log.warning("no status file: %s", error)

    def _wire_name(self, name: str) -> str:
        path = str(self._album.path(name))
        return path if name and len(path.encode()) <= _LONGEST_NAME else name

    def _write(self, what: str, write: Any, value: Any) -> bool:
        try:
            write(value)
        except JournalError as error:
            if not self._failing:
                log.error("%s not kept: %s", what, error)
            self._failing = True
            return False
        self._failing = False
        return True
