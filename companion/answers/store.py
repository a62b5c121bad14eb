"""Stores replies over a restart, so that an answer that is sent again after it is not applied twice."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from companion.link.inbound import AnswerRequest
from companion.wire.answers import Acknowledgement
from companion.wire.ids import CHANGING_RESULTS, Result

_CAPACITY = 16


@dataclass(frozen=True)
class StoredReply:
    """The reply to a transaction that changed something. target: the id that it was applied to, or 0."""

    sender: tuple[int, int]
    transaction: int
    target: int
    result: Result
    text: str

    def saved(self) -> list[Any]:
        """Return the reply as JSON values."""
        return [*self.sender, self.transaction, self.target, int(self.result), self.text]


class AnswerStore:
    """Stores the newest 16 replies to answers that changed something.

    An answer that is sent again after a restart gets its reply again, and is not applied twice.
    """

    def __init__(self, saved: Any) -> None:
        """saved: what `saved` returned before the restart. Anything else in it is ignored."""
        rows = saved if isinstance(saved, list) else []
        read = [reply for row in rows if (reply := _read(row)) is not None]
        self._before = {(reply.sender, reply.transaction): reply for reply in read}
        self._replies = deque(read, _CAPACITY)

    def before_restart(self, request: AnswerRequest) -> StoredReply | None:
        """Return the reply from before the restart, None without one. The link repeats later replies."""
        return self._before.get((request.sender, request.transaction or 0))

    def add(self, request: AnswerRequest, acknowledgement: Acknowledgement) -> None:
        """Store a reply.

        A reply to what changed nothing is not stored, nor one to a command: without a transaction number each
        command is a new request.
        """
        if request.transaction is not None and acknowledgement.result in CHANGING_RESULTS:
            self._replies.append(
                StoredReply(
                    request.sender,
                    request.transaction,
                    acknowledgement.target,
                    acknowledgement.result,
                    acknowledgement.text,
                )
            )

    def saved(self) -> list[list[Any]]:
        """Return all replies as JSON values for the journal."""
        return [reply.saved() for reply in self._replies]


def _read(row: Any) -> StoredReply | None:
    try:
        system, component, transaction, target, result, text = row
        return StoredReply(
            (int(system), int(component)), int(transaction), int(target), Result(result), str(text)
        )
    except (TypeError, ValueError, OverflowError):
        return None
