"""Decides whose messages are accepted and how often each sender may ask, and counts what is rejected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from companion.link.limits import LeaseTable, TokenBucket
from companion.link.signing import Signing
from companion.wire.ids import SenderId
from companion.wire.refusals import Rejected

REQUESTS_PER_SECOND = 20.0
REQUESTS_AT_ONCE = 60.0
READERS_PER_SECOND = 5.0
READERS_AT_ONCE = 20.0
MAX_SHARES = 4
KEPT = 10.0
"""s of silence after which another sender may have the share."""
READERS: SenderId = (0, 0)
"""All senders that may only read share one rate limit: many ids gain a sender nothing."""
OTHER_OPERATORS: SenderId = (0, 1)
"""All senders that may change something and have no share of their own share one rate limit, too."""
COMMON_SHARES = frozenset({READERS, OTHER_OPERATORS})
_Buckets = dict[str, TokenBucket]


class AccessControl:
    """Checks signatures, the allow-list and request rates. `rejected` counts by reason.

    The first four senders that may change something have a rate limit each, for as long as they are received;
    the others share one. So the sum of all requests is bounded, whatever ids a sender uses.
    """

    def __init__(self, allowed: tuple[int, int], signing: Signing | None = None) -> None:
        self._allowed = allowed
        self._signing = signing
        self._shares: LeaseTable[SenderId, _Buckets] = LeaseTable(MAX_SHARES, KEPT)
        self._common: dict[SenderId, _Buckets] = {READERS: {}, OTHER_OPERATORS: {}}
        self.rejected: Counter[Rejected] = Counter()

    def accepts(self, message: Any, now: float, *, first: bool) -> bool:
        """Whether to accept a message at all: where a key is set, whether it is signed and new.

        first: whether it came by the first connection.
        """
        if self._signing is None:
            return True
        if self._signing.is_radio_report(message):
            return False
        reason = self._signing.refusal(message, now, first=first)
        if reason:
            self.rejected[reason] += 1
        return not reason

    def may_change(self, sender: SenderId) -> bool:
        """Whether the sender's system id may answer calls and set values."""
        return self._allowed[0] <= sender[0] <= self._allowed[1]

    def permits(self, sender: SenderId, now: float, refuse: Callable[[SenderId, float], None]) -> bool:
        """Whether `sender` may change something. Where not, it is counted, and `refuse` tells it."""
        if self.may_change(sender):
            return True
        self.rejected["sender"] += 1
        refuse(sender, now)
        return False

    def renew_share(self, sender: SenderId, now: float) -> None:
        """Renew the share of `sender`, who sent something."""
        if self.may_change(sender):
            self._shares.renew(sender, self._shares.get(sender) or {}, now)

    def share(self, sender: SenderId) -> SenderId:
        """The key of the rate limit that `sender` counts under: its own id, OTHER_OPERATORS or READERS."""
        if sender in self._shares:
            return sender
        return OTHER_OPERATORS if self.may_change(sender) else READERS

    def outranks(self, sender: SenderId, other: SenderId) -> bool:
        """Whether `sender` goes before `other` where places are scarce.

        A share of its own counts, and the right to change something.
        """
        return self._rank(sender) > self._rank(other)

    def admits(self, sender: SenderId, now: float, *, kind: str = "") -> bool:
        """Count one request of `sender`; False above its rate: 20 a second after a burst of 60.

        The senders that may only read have 5 a second together, after a burst of 20. kind: a kind of request
        with a rate limit of its own, so that a download does not block an answer.
        """
        share = self.share(sender)
        buckets = self._shares.get(share)
        if buckets is None:
            buckets = self._common[share]
        if kind not in buckets:
            buckets[kind] = (
                TokenBucket(READERS_PER_SECOND, READERS_AT_ONCE, now)
                if share == READERS
                else TokenBucket(REQUESTS_PER_SECOND, REQUESTS_AT_ONCE, now)
            )
        if buckets[kind].take(1, now):
            return True
        self.rejected["rate"] += 1
        return False

    def _rank(self, sender: SenderId) -> int:
        return (sender in self._shares) + self.may_change(sender)
