"""An answer or a policy on its way: sent again with back-off until something settles it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from companion.wire.answers import MAX_PAYLOAD, MAX_WORD_BYTES, Acknowledgement, AnswerMessage, Operation
from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID, SET_POLICY, Motion, Policy
from companion.wire.packing import PayloadError

LIFETIME_S = 60.0
FIRST_BACK_OFF_S = 1.0
LONGEST_BACK_OFF_S = 4.0
GRACE_S = 2.0
"""How long the acknowledgement may come after the call was heard to be closed."""
BLOCKS_S = 8.0
"""An answer keeps later ones to the same rover back for so long at most: their order matters."""
MAX_PARTS = 4


class Status(Enum):
    """Where an answer is. The last three are final."""

    WAITING = "waiting"
    """Not sent yet: the rover is not heard, or an earlier answer goes first."""
    SENT = "sent"
    ACKNOWLEDGED = "acknowledged"
    CLOSED = "closed"
    """The call was closed before an acknowledgement came."""
    EXPIRED = "expired"
    """No acknowledgement within 60 s."""


def split(transaction: int, target: int, motion: Motion, operations: Sequence[Operation]) -> list[bytes]:
    """The payloads of an answer, each at most 128 bytes; as few parts as there can be in order.

    Raises PayloadError for more than four parts, or a word of more than 96 bytes.
    """
    groups: list[list[Operation]] = [[]]
    size = empty = len(AnswerMessage(transaction, target, motion).pack())
    for operation in operations:
        word = getattr(operation, "word", "")
        if len(word.encode()) > MAX_WORD_BYTES:
            raise PayloadError(f'"{word[:20]}..." is over {MAX_WORD_BYTES} bytes: use a shorter word')
        grown = len(AnswerMessage(transaction, target, motion, (operation,)).pack()) - empty
        if size + grown > MAX_PAYLOAD:
            groups.append([])
            size = empty
        groups[-1].append(operation)
        size += grown
    if len(groups) > MAX_PARTS:
        raise PayloadError(f"{len(operations)} changes are too long for one answer: send them in two")
    return [
        AnswerMessage(transaction, target, motion, tuple(group), part, len(groups)).pack()
        for part, group in enumerate(groups)
    ]


@dataclass(eq=False)
class Pending:
    """One answer to one rover. The owner asks `due` for the next payload and tells it what was heard."""

    system: int
    target: int
    motion: Motion
    operations: tuple[Operation, ...]
    transaction: int
    created: float
    status: Status = Status.WAITING
    acknowledgement: Acknowledgement | None = None
    rounds: int = 0
    first_sent: float | None = None
    _payloads: list[bytes] = field(default_factory=list)
    _part: int = 0
    _next_at: float = 0.0
    _closed_at: float | None = None

    def __post_init__(self) -> None:
        self._payloads = split(self.transaction, self.target, self.motion, self.operations)
        self._next_at = self.created

    @property
    def settled(self) -> bool:
        """Nothing more will be sent."""
        return self.status not in (Status.WAITING, Status.SENT)

    def blocks(self, now: float) -> bool:
        """Later answers must wait for this one."""
        if self.settled or self._closed_at is not None:
            return False
        return self.first_sent is None or now - self.first_sent < BLOCKS_S

    def due(self, now: float) -> bytes | None:
        """The payload to send now, if any."""
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
        self.status = Status.SENT
        return payload

    def acknowledge(self, acknowledgement: Acknowledgement, *, final: bool) -> None:
        """The rover has spoken; when it is not final, sending goes on."""
        self.acknowledgement = acknowledgement
        if final:
            self.status = Status.ACKNOWLEDGED

    def close(self, now: float) -> None:
        """The call is closed: send no more; the acknowledgement may still come for a moment."""
        if self._closed_at is None:
            self._closed_at = now

    def settle(self, now: float) -> bool:
        """True when time alone has settled it just now."""
        if self.settled:
            return False
        if self._closed_at is not None and (self.first_sent is None or now - self._closed_at >= GRACE_S):
            self.status = Status.CLOSED
        elif now - self.created >= LIFETIME_S:
            self.status = Status.EXPIRED
        return self.settled


class PolicyRequested(Enum):
    """What became of it. All but the first two are final."""

    WAITING = "waiting"
    """Not sent yet: the companion is not heard."""
    SENT = "sent"
    GRANTED = "granted"
    REFUSED = "refused"
    """A text of the rover's says why."""
    EXPIRED = "expired"
    """No word within 60 s."""


@dataclass(eq=False)
class PolicyOnItsWay:
    """One policy for one rover; the owner asks `due` for what to send now and tells it what was heard."""

    system: int
    policy: Policy
    created: float
    status: PolicyRequested = PolicyRequested.WAITING
    _rounds: int = 0
    _next_at: float = 0.0

    @property
    def settled(self) -> bool:
        """Nothing more will be sent."""
        return self.status not in (PolicyRequested.WAITING, PolicyRequested.SENT)

    def due(self, now: float) -> Any | None:
        """The command to send now, if any. The companion acts on the first, and acknowledges each."""
        if self.settled or now < self._next_at:
            return None
        again = min(self._rounds, 0xFF)
        self._next_at = now + min(FIRST_BACK_OFF_S * 2**again, LONGEST_BACK_OFF_S)
        self._rounds += 1
        self.status = PolicyRequested.SENT
        return mavlink.MAVLink_command_long_message(
            self.system, COMPONENT_ID, ANSWER_COMMAND, again, 0, SET_POLICY, self.policy, 0, 0, 0, 0
        )

    def acknowledge(self, *, granted: bool) -> bool:
        """The rover has spoken; True when that settled it."""
        if self.status is not PolicyRequested.SENT:
            return False
        self.status = PolicyRequested.GRANTED if granted else PolicyRequested.REFUSED
        return True

    def settle(self, now: float) -> bool:
        """True when time alone has settled it just now."""
        if self.settled or now - self.created < LIFETIME_S:
            return False
        self.status = PolicyRequested.EXPIRED
        return True
