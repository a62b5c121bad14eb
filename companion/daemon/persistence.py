"""Queues for the journal what must survive a restart, and tells what waits for it when it is on disk."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from anytraverse.memory import Memory
from companion.calls.decisions import Call
from companion.calls.machine import OperatorCalls
from companion.calls.snapshot import snapshot
from companion.calls.summary import recorded
from companion.daemon.answers.handler import Reply
from companion.link.answer_store import AnswerStore
from companion.storage import Batch, JournalError, TableRow
from companion.storage.batch import as_json
from companion.storage.writer import SLOW, Writer
from companion.vision.messages import LARGEST_PNG
from companion.wire.words_text import operation_text

log = logging.getLogger(__name__)

_RESERVED = 4
"""Ids that the journal's counter is raised by at a time."""
_MOST_IDS = 0xFFFF

WriteCallback = Callable[[bool, float], None]
"""Called with whether a turn's changes are on disk, once that is known, and with monotonic seconds."""


class Persistence:
    """Collects the changes of a turn of the main loop for the writer, and knows which are on disk.

    Never waits: a message that must not be sent before a change is on disk is registered with `after_write`.
    """

    def __init__(
        self,
        writer: Writer,
        calls: OperatorCalls,
        answers: AnswerStore,
        frame_id: int,
        stamp: Callable[[], float],
    ) -> None:
        """frame_id: the newest id of a call's or hold's frame, over all restarts: none may be used twice.

        stamp: gives seconds since 1970.
        """
        self._writer = writer
        self._calls = calls
        self._answer_store = answers
        self._changes = Batch()
        """The changes of this turn."""
        self._callbacks: list[WriteCallback] = []
        """Those that wait for the changes of this turn."""
        self._waiting: deque[tuple[int, float, list[WriteCallback]]] = deque()
        self._ticket = 0
        self._memory: Memory | None = None
        self._memory_ticket, self._memory_at = 0, 0.0
        self._state: dict[str, Any] = {}
        self._last_id = 0
        self._frame_id = frame_id
        self.stamp = stamp

    @property
    def failing(self) -> bool:
        """Whether the last write to the journal failed, or the disk is slow."""
        return self._writer.failing

    def save_memory(self, memory: Memory) -> None:
        """Queue the algorithm's memory, with the other changes of this turn."""
        if memory is not self._memory:
            self._memory = memory
            self._changes = self._changes.merged_with(Batch(memory=memory))

    def memory_stored(self, now: float, memory: Memory | None = None) -> bool:
        """Whether frames judged by the newest memory may let the vehicle drive on.

        They may once that memory is on disk. They may, too, when it could not be written within `SLOW`
        seconds: a full disk alone must not hold the vehicle for ever.
        memory: the one by which a frame was judged, or which is in use; False when a different one was queued
        last.
        """
        if memory is not None and self._memory is not None and memory is not self._memory:
            return False
        return (
            self._changes.memory is None
            and self._is_on_disk(self._memory_ticket, self._memory_at, now) is not None
        )

    def save_answer(self, reply: Reply) -> Mapping[str, Any] | None:
        """Queue an answer that changed something, and its reply.

        Return the answer's record with its time, None for one that was for no call or hold.
        """
        answer, acknowledgement = reply.answer, reply.acknowledgement
        self._answer_store.save(answer, acknowledgement)
        target = acknowledgement.target
        if target == 0:
            return None
        record = {
            "motion": answer.motion.name.lower(),
            "operations": [operation_text(operation) for operation in answer.operations],
            "sender": list(answer.sender),
            "transaction": answer.transaction,
            "result": acknowledgement.result.name.lower(),
            "text": acknowledgement.text,
        }
        at = self.stamp()
        self._queue(lambda: Batch(rows=(TableRow.of_answer(target, record, at),)))
        return {"at": round(at, 2), **record}

    def save_closed_call(self, call: Call, at: float) -> None:
        """Queue a closed call. at: seconds since 1970."""
        self._queue(lambda: Batch(rows=(TableRow.of_call(recorded(call), at),)))

    def save_frame(self, frame_id: int, png: bytes) -> None:
        """Queue the frame of the open call. It replaces the one before."""
        if len(png) > LARGEST_PNG:
            log.error(
                "the frame of the call is not stored: %d bytes, at most %d: set a smaller picture",
                len(png),
                LARGEST_PNG,
            )
            return
        self._changes = self._changes.merged_with(Batch(frame=(frame_id, png)))

    def save_calls(self, settings: Mapping[str, Any], now: float) -> None:
        """Queue the open call, the hold, the counter of ids, the replies and `settings`, if they changed.

        Call it once a turn, after all else: all changes of the turn go into one transaction. The replies are
        in it, so that an answer that is sent again after a restart is recognised. settings: JSON values.
        """
        calls = self._calls
        call_frame = calls.call.frame_id if calls.call else 0
        hold_frame = calls.hold.seen.frame.id if calls.hold and calls.hold.seen else 0
        self._frame_id = max(self._frame_id, call_frame, hold_frame)
        self._last_id = calls.last_id
        state = {
            **snapshot(calls),
            **settings,
            "last_id": _reserved(calls.last_id),
            "frame_id": self._frame_id,
            "replies": self._answer_store.saved(),
        }
        if state != self._state:
            # The writer always holds the whole state, so that of several waiting states the newest suffices.
            self._state = state
            self._queue(lambda: Batch(state=as_json(state)))
        if self._changes:
            self._ticket = self._writer.queue_batch(self._changes)
            if self._changes.memory is not None:
                self._memory_ticket, self._memory_at = self._ticket, now
            self._changes = Batch()
        if self._callbacks:
            self._waiting.append((self._ticket, now, self._callbacks))
            self._callbacks = []

    def after_write(self, callback: WriteCallback) -> None:
        """Make `due` return `callback` once this turn's changes are on disk, or `SLOW` s have passed."""
        self._callbacks.append(callback)

    def due(self, now: float) -> list[tuple[WriteCallback, bool]]:
        """Return what may be called now, in order, and whether its turn's changes are on disk."""
        found: list[tuple[WriteCallback, bool]] = []
        while self._waiting:
            ticket, at, callbacks = self._waiting[0]
            stored = self._is_on_disk(ticket, at, now)
            if stored is None:
                break
            self._waiting.popleft()
            found += [(callback, stored) for callback in callbacks]
        return found

    def leave(self) -> None:
        """Queue the exact counter of ids.

        Nothing more will be sent, so that no ids need to be reserved: the next start goes on with the next.
        """
        if self._state:
            self._writer.queue_batch(Batch(state=as_json({**self._state, "last_id": self._last_id})))

    def _is_on_disk(self, ticket: int, at: float, now: float) -> bool | None:
        """Whether what was queued at `at` is on disk; None while that is not known."""
        if self._writer.committed >= ticket:
            return True
        return False if self._writer.failed >= ticket or now - at >= SLOW else None

    def _queue(self, made: Callable[[], Batch]) -> None:
        try:
            self._changes = self._changes.merged_with(made())
        except JournalError as error:
            log.error("not stored: %s", error)


def _reserved(last_id: int) -> int:
    """Return the counter of ids as it is stored: ahead of `last_id`, by up to two blocks of `_RESERVED`.

    So an id may be sent before it is on disk. After a kill the ids between are skipped; none is used twice.
    """
    ahead = (last_id // _RESERVED + 2) * _RESERVED
    return ahead if ahead <= _MOST_IDS else ahead - _MOST_IDS
