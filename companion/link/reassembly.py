"""Reassembles answers that come in several payloads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from companion.link.answer_store import SenderCache
from companion.wire.answers import AnswerMessage
from companion.wire.delivery import MAX_PARTS
from companion.wire.ids import SenderId
from companion.wire.packing import PayloadError

OF_A_SENDER, IN_ALL = 8, 1024
"""Incomplete answers of one sender and in all: more than the senders of one shared rate may begin in 30 s."""
PATIENCE = 30.0
"""s to wait for the next part. A sender that backs off, on a radio that loses half, takes 8 to 16 s."""


@dataclass
class _Pieces:
    newest_at: float
    parts: dict[int, AnswerMessage] = field(default_factory=dict)


class Reassembly:
    """Reassembles answers that come in two to four parts; at most eight of one sender at once."""

    def __init__(self) -> None:
        self._open: SenderCache[_Pieces] = SenderCache(OF_A_SENDER, IN_ALL)

    def add(self, sender: SenderId, part: AnswerMessage, now: float) -> AnswerMessage | None:
        """Add a part; return the whole answer, operations in order, when it completes one, else None.

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
        if any(_envelope(other) != _envelope(part) for other in pieces.parts.values()):
            self._open.pop(key)
            raise PayloadError("the parts do not belong together")
        pieces.parts[part.part] = part
        if len(pieces.parts) < part.parts:
            return None
        self._open.pop(key)
        operations = tuple(op for number in range(part.parts) for op in pieces.parts[number].operations)
        return replace(part, operations=operations, part=0, parts=1)


def _envelope(part: AnswerMessage) -> tuple[int, int, int]:
    return part.target, part.motion, part.parts
