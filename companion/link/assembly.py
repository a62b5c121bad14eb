"""Answers that come in several parts."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace

from companion.link.heard import Sender
from companion.wire.answers import AnswerMessage
from companion.wire.packing import PayloadError

MAX_PARTS = 4
MAX_OPEN = 8
PATIENCE = 30.0
"""s without another part; a sender that backs off and a radio that loses half take 8 s or twice that."""


@dataclass
class _Pieces:
    newest_at: float
    parts: dict[int, AnswerMessage] = field(default_factory=dict)


class Assembly:
    """Collects at most four parts of an answer, 30 s from one to the next; at most eight answers at once."""

    def __init__(self) -> None:
        self._open: OrderedDict[tuple[Sender, int], _Pieces] = OrderedDict()

    def add(self, sender: Sender, part: AnswerMessage, now: float) -> AnswerMessage | None:
        """The whole answer with the operations of all parts in order, once the last one is here.

        Raises PayloadError for more than four parts, and for parts that contradict each other.
        """
        if part.parts == 1:
            return part
        if part.parts > MAX_PARTS:
            raise PayloadError(f"{part.parts} parts, at most {MAX_PARTS}")
        self._open = OrderedDict((k, p) for k, p in self._open.items() if now - p.newest_at < PATIENCE)
        key = (sender, part.transaction)
        pieces = self._open.setdefault(key, _Pieces(now))
        pieces.newest_at = now
        self._open.move_to_end(key)
        if len(self._open) > MAX_OPEN:
            self._open.popitem(last=False)
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
