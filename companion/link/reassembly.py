"""Reassembles answers that come in several payloads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import chain

from companion.link.answer_store import SenderCache
from companion.wire.answers import Answer, AnyOperation
from companion.wire.delivery import MAX_PARTS
from companion.wire.ids import Motion
from companion.wire.packing import PayloadError

OF_A_SENDER, IN_ALL = 8, 1024
"""Incomplete answers of one sender and in all: more than the senders of one shared rate may begin in 30 s."""
PATIENCE = 30.0
"""s to wait for the next part. A sender that backs off, on a radio that loses half, takes 8 to 16 s."""


@dataclass
class _Pieces:
    newest_at: float
    envelope: tuple[int, Motion, int]
    """Target, motion and number of parts, which all parts have in common."""
    operations: dict[int, tuple[AnyOperation, ...]] = field(default_factory=dict)
    """By part."""


class Reassembly:
    """Reassembles answers that come in two to four parts; at most eight of one sender at once."""

    def __init__(self) -> None:
        self._open: SenderCache[_Pieces] = SenderCache(OF_A_SENDER, IN_ALL)

    def add(self, answer: Answer, part: int, parts: int, now: float) -> Answer | None:
        """Add a part; return the whole answer, operations in order, when it completes one, else None.

        Raises PayloadError for more than four parts, and for parts that contradict each other.
        """
        if parts == 1:
            return answer
        if parts > MAX_PARTS:
            raise PayloadError(f"{parts} parts, at most {MAX_PARTS}")
        key, envelope = (answer.sender, answer.transaction), (answer.target, answer.motion, parts)
        pieces = self._open.get(key)
        if pieces is None or now - pieces.newest_at >= PATIENCE:
            pieces = _Pieces(now, envelope)
        pieces.newest_at = now
        self._open.put(key, pieces)
        if pieces.envelope != envelope:
            self._open.pop(key)
            raise PayloadError("the parts do not belong together")
        pieces.operations[part] = answer.operations
        if len(pieces.operations) < parts:
            return None
        self._open.pop(key)
        return replace(answer, operations=tuple(chain(*(pieces.operations[one] for one in range(parts)))))
