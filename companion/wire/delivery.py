"""Delivers an answer: sends it again with back-off until it is settled, and words what became of it."""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum

from companion.wire.answers import (
    MAX_PAYLOAD,
    MAX_WORD_BYTES,
    Acknowledgement,
    Answer,
    AnyOperation,
    CancelIncident,
    PackIncident,
)
from companion.wire.ids import CHANGING_RESULTS, Motion, Result
from companion.wire.packing import PayloadError, clean
from companion.wire.texts import percent

LIFETIME_S = 60.0
FIRST_BACK_OFF_S = 1.0
LONGEST_BACK_OFF_S = 4.0
GRACE_S = 5.0
"""How long an acknowledgement is awaited after the call's closing was received. The rover closes the call at
once, but may hold the acknowledgement back for 2 s while its disk is slow; the radio's delay comes on top."""
BLOCKS_S = 8.0
"""An answer delays later ones to the same rover for at most this time, since their order matters. It does not
delay a stay."""
MAX_PARTS = 4


class DeliveryStatus(Enum):
    """Names the status of an answer. The last three are final."""

    WAITING = "waiting"
    """Not sent yet: the rover is not heard, or an earlier answer must be acknowledged first."""
    SENT = "sent"
    ACKNOWLEDGED = "acknowledged"
    CLOSED = "closed"
    """The call was closed, or a stay overruled this go, before an acknowledgement came."""
    EXPIRED = "expired"
    """No acknowledgement within 60 s."""


STATUS_TEXTS = {
    DeliveryStatus.WAITING: "waits: the companion is not heard, or has not acknowledged the answer before",
    DeliveryStatus.SENT: "sent",
    DeliveryStatus.ACKNOWLEDGED: "acknowledged",
    DeliveryStatus.CLOSED: "not acknowledged: the call was closed meanwhile, or stay was said",
    DeliveryStatus.EXPIRED: "LOST: no acknowledgement within 60 s",
}
_RESULTS = {
    Result.APPLIED: "done",
    Result.APPLIED_NOT_REMEMBERED: "done, but not remembered after a restart",
    Result.NOT_COVERED: "taken, but it does not cover what was seen",
    Result.STALE: "too late: it is not open",
    Result.REFUSED: "REFUSED, nothing changed",
    Result.DENIED: "DENIED: this ground station may not",
    Result.BUSY: "busy, will be sent again",
}


def result_text(ack: Acknowledgement) -> str:
    """Word what became of an answer, with the figures of the call's frame judged again."""
    figures = []
    if ack.roi_uncertainty is not None:
        figures.append(f"now {percent(ack.roi_uncertainty)} unexplained")
    if ack.worst_tile is not None:
        figures.append(f"worst tile {percent(ack.worst_tile)}")
    told = f": {clean(ack.text)}" if clean(ack.text) else ""
    return f"{_RESULTS[ack.result]}{''.join(f', {figure}' for figure in figures)}{told}"


def split(answer: Answer) -> list[bytes]:
    """Pack an answer into as few payloads as possible, in order, each of at most 128 bytes.

    Raises PayloadError for more than four parts, or a word of more than 96 bytes.
    """
    groups: list[list[AnyOperation]] = [[]]
    size = empty = len(replace(answer, operations=()).pack())
    for operation in answer.operations:
        word = getattr(operation, "word", "")
        if len(word.encode()) > MAX_WORD_BYTES:
            raise PayloadError(f'"{word[:20]}..." is over {MAX_WORD_BYTES} bytes: use a shorter word')
        grown = len(replace(answer, operations=(operation,)).pack()) - empty
        if size + grown > MAX_PAYLOAD:
            groups.append([])
            size = empty
        groups[-1].append(operation)
        size += grown
    if len(groups) > MAX_PARTS:
        raise PayloadError(f"{len(answer.operations)} changes are too long for one answer: send them in two")
    return [
        replace(answer, operations=tuple(group)).pack(part, len(groups)) for part, group in enumerate(groups)
    ]


def random_transaction() -> int:
    """Return a new id for an answer."""
    return secrets.randbelow(0xFFFFFFFF) + 1


@dataclass(eq=False)
class Pending:
    """Delivers one answer to one rover. The owner sends what `due` returns, and reports acknowledgements.

    answer: with its transaction. rounds: how often all parts were sent. Times are those of `now`.
    """

    system: int
    answer: Answer
    created: float
    status: DeliveryStatus = DeliveryStatus.WAITING
    acknowledgement: Acknowledgement | None = None
    rounds: int = 0
    first_sent: float | None = None
    _payloads: list[bytes] = field(default_factory=list)
    _part: int = 0
    _next_at: float = 0.0
    _closed_at: float | None = None

    def __post_init__(self) -> None:
        self._payloads = split(self.answer)
        self._next_at = self.created

    @property
    def urgency(self) -> tuple[bool, float]:
        """Sorts answers to one rover: in this order they are sent. A stay waits for none."""
        return self.answer.motion is not Motion.STAY, self.created

    @property
    def settled(self) -> bool:
        """Whether nothing more will be sent."""
        return self.status not in (DeliveryStatus.WAITING, DeliveryStatus.SENT)

    @property
    def applied(self) -> bool:
        """Whether the rover has said that it was applied."""
        return self.acknowledgement is not None and self.acknowledgement.result in CHANGING_RESULTS

    @property
    def told(self) -> str:
        """What became of it, for a person."""
        if self.acknowledgement is not None and self.status is DeliveryStatus.ACKNOWLEDGED:
            return result_text(self.acknowledgement)
        return STATUS_TEXTS[self.status]

    def blocks(self, now: float) -> bool:
        """Return whether later answers to the same rover must wait for this one."""
        if self.settled or self._closed_at is not None:
            return False
        if self.answer.about_files:
            return False  # it changes nothing of a call, so that no answer has to wait for it
        return self.first_sent is None or now - self.first_sent < BLOCKS_S

    def due(self, now: float) -> bytes | None:
        """Return the payload to send now, or None."""
        if self.settled or self._closed_at is not None or now < self._next_at:
            return None
        payload = self._payloads[self._part]
        self._part += 1
        if self._part == len(self._payloads):
            self._part = 0
            self._next_at = now + min(FIRST_BACK_OFF_S * 2**self.rounds, LONGEST_BACK_OFF_S)
            self.rounds += 1
        if self.first_sent is None:
            self.first_sent = now
        self.status = DeliveryStatus.SENT
        return payload

    def acknowledge(self, acknowledgement: Acknowledgement, *, final: bool) -> None:
        """Take in an acknowledgement; when it is not final, sending continues."""
        self.acknowledgement = acknowledgement
        if final:
            self.status = DeliveryStatus.ACKNOWLEDGED

    def overrule(self, others: Iterable[Pending], now: float) -> None:
        """Send no more what would come after this and undo it.

        That is a go to the call of a stay, and a request to pack the incident that this cancels.
        """
        own = self.answer
        cancelled = tuple(PackIncident(one.id) for one in own.operations if isinstance(one, CancelIncident))
        for other in others:
            if other.system != self.system:
                continue
            go = (other.answer.target, other.answer.motion) == (own.target, Motion.GO)
            if (own.motion is Motion.STAY and go) or (cancelled and other.answer.operations == cancelled):
                other.close(now)

    def close(self, now: float) -> None:
        """Send no more, since the call is closed, or a stay was said.

        An acknowledgement is still awaited for `GRACE_S`.
        """
        if self._closed_at is None:
            self._closed_at = now

    def settle(self, now: float) -> bool:
        """Apply time limits; return True when they settled it in this call."""
        if self.settled:
            return False
        if self._closed_at is not None and (self.first_sent is None or now - self._closed_at >= GRACE_S):
            self.status = DeliveryStatus.CLOSED
        elif now - self.created >= LIFETIME_S:
            self.status = DeliveryStatus.EXPIRED
        return self.settled
