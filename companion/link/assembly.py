"""Answers that come in several parts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from companion.link.heard import Sender
from companion.link.remembered import Remembered
from companion.wire.answers import AnswerMessage
from companion.wire.packing import PayloadError

MAX_PARTS = 4
OF_A_SENDER, IN_ALL = 8, 1024
"""In all more than are admitted in 30 s of those who share, however many names they have."""
PATIENCE = 30.0
"""s without another part; a sender that backs off and a radio that loses half take 8 s or twice that."""


@dataclass
class _Pieces:
    newest_at: float
    parts: dict[int, AnswerMessage] = field(default_factory=dict)


class Assembly:
    """Collects at most four parts of an answer, 30 s from one to the next; of a sender eight at once."""

    def __init__(self) -> None:
        self._open: Remembered[_Pieces] = Remembered(OF_A_SENDER, IN_ALL)

    def add(self, sender: Sender, part: AnswerMessage, now: float) -> AnswerMessage | None:
        """The whole answer with the operations of all parts in order, once the last one is here.

        Raises PayloadError for more than four parts, and for parts that contradict each other.
        """
        if part.parts == 1:
            return part
        if part.parts > MAX_PARTS:
            raise PayloadError(f"{part.parts} parts, at most {MAX_PARTS}")
        key = (sender, part.transaction)
        pieces = self._open.get(key)
        if pieces is None or now - pieces.newest_at >= PATIENCE:
            pieces = _Pieces(now)
        pieces.newest_at = now
        self._open.put(key, pieces)
        if any(_frame(other) != _frame(part) for other in pieces.parts.values()):
            self._open.pop(key)
            raise PayloadError("the parts do not belong together")
        pieces.parts[part.part] = part
        if len(pieces.parts) < part.parts:
            return None
        self._open.pop(key)
        operations = tuple(op for number in range(part.parts) for op in pieces.parts[number].operations)
        return replace(part, operations=operations, part=0, parts=1)


def _frame(part: AnswerMessage) -> tuple[int, int, int]:
    return part.target, part.motion, part.parts
