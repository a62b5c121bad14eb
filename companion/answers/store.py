"""Replies that survive a restart: an answer that is asked again after one is applied once, not twice."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from companion.link.inbound import AnswerRequest
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Result

_REPLIES = 16
_DONE = {Result.APPLIED, Result.APPLIED_NOT_REMEMBERED, Result.NOT_COVERED}


@dataclass(frozen=True)
class StoredReply:
    """What was answered to a transaction that changed something. target: the id it was applied to, or 0."""

    sender: tuple[int, int]
    transaction: int
    target: int
    result: Result
    text: str

    def saved(self) -> list[Any]:
        """As JSON values."""
        return [*self.sender, self.transaction, self.target, int(self.result), self.text]


class AnswerStore:
    """The newest replies that changed something, which survive a restart: 16 of them.

    An answer that is asked again after a restart is applied once, not twice.
    """

    def __init__(self, saved: Any) -> None:
        """saved: what `saved` made before the restart; whatever else it is counts for nothing."""
        rows = saved if isinstance(saved, list) else []
        self._before = {(one.sender, one.transaction): one for row in rows if (one := _read(row)) is not None}
        self._replies = deque(self._before.values(), _REPLIES)

    def before_restart(self, request: AnswerRequest) -> StoredReply | None:
        """What was answered to it before the restart. The link itself knows what was answered since."""
        return self._before.get((request.sender, request.transaction or 0))

    def add(self, request: AnswerRequest, acknowledgement: Acknowledgement) -> None:
        """Not what changed nothing, nor a command: without a transaction it is always a new wish."""
        if request.transaction is not None and acknowledgement.result in _DONE:
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
        """For the journal: JSON values."""
        return [reply.saved() for reply in self._replies]


def _read(row: Any) -> StoredReply | None:
    try:
        system, component, transaction, target, result, text = row
        return StoredReply(
            (int(system), int(component)), int(transaction), int(target), Result(result), str(text)
        )
    except (TypeError, ValueError):
        return None
