"""Replies that survive a restart: an answer that is asked again after one is applied once, not twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from companion.link.inbound import AnswerRequest
from companion.wire.answers import Acknowledgement
from companion.wire.ids import Result

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


def stored_reply(request: AnswerRequest, acknowledgement: Acknowledgement) -> StoredReply | None:
    """None for what changed nothing, and for a command: without a transaction it is always a new wish."""
    if request.transaction is None or acknowledgement.result not in _DONE:
        return None
    return StoredReply(
        request.sender,
        request.transaction,
        acknowledgement.target,
        acknowledgement.result,
        acknowledgement.text,
    )


def read_replies(saved: Any) -> list[StoredReply]:
    """What `StoredReply.saved` made. Whatever else it is counts for nothing."""
    if not isinstance(saved, list):
        return []
    return [kept for row in saved if (kept := _read(row)) is not None]


def _read(row: Any) -> StoredReply | None:
    try:
        system, component, transaction, target, result, text = row
        return StoredReply(
            (int(system), int(component)), int(transaction), int(target), Result(result), str(text)
        )
    except (TypeError, ValueError):
        return None
