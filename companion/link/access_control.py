"""Who may ask, how often, and what was turned away."""

from __future__ import annotations

from collections import Counter
from typing import Any

from companion.link.inbound import Sender
from companion.link.limits import LeaseTable, TokenBucket
from companion.link.signing import Signing
from companion.wire.refusals import Rejected

REQUESTS_PER_SECOND = 20.0
REQUESTS_AT_ONCE = 60.0
STRANGERS_PER_SECOND = 5.0
STRANGERS_AT_ONCE = 20.0
UNDECIDED_FOR = 30.0
"""s for which a request that is not decided yet is not handed on again, where nothing else is known."""
MAX_SHARES = 4
KEPT = 10.0
"""s without a word after which another sender may have the share."""
STRANGERS: Sender = (0, 0)
"""Who may only read counts as one: under many names nobody gets more than his share."""
OTHERS: Sender = (0, 1)
"""So does everybody who may change something and has no share of his own."""
CROWDS = frozenset({STRANGERS, OTHERS})
_Buckets = dict[str, TokenBucket]


class AccessControl:
    """Signatures, the allow-list and the requests' rates. `rejected` counts by reason.

    undecided_for: s for which the same request is not handed on again while nobody has decided it.

    The first four senders that may change something have a share each, for as long as they are heard; all
    others have one together. So what all may ask is bounded, however many names they have.
    """

    def __init__(self, allowed: tuple[int, int], signing: Signing | None = None) -> None:
        self._allowed = allowed
        self._signing = signing
        self._shares: LeaseTable[Sender, _Buckets] = LeaseTable(MAX_SHARES, KEPT)
        self._common: dict[Sender, _Buckets] = {STRANGERS: {}, OTHERS: {}}
        self.rejected: Counter[Rejected] = Counter()
        self.undecided_for = UNDECIDED_FOR

    def believes(self, message: Any, now: float) -> bool:
        """Whether a message may be heard at all: with a key, whether it is signed and new."""
        if self._signing is None:
            return True
        if self._signing.passes_over(message):
            return False
        reason = self._signing.refusal(message, now)
        if reason:
            self.rejected[reason] += 1
        return not reason

    def may_change(self, sender: Sender) -> bool:
        """Whether this system id may answer calls and set values."""
        return self._allowed[0] <= sender[0] <= self._allowed[1]

    def hear(self, sender: Sender, now: float) -> None:
        """`sender` said something, which keeps his share for him."""
        if self.may_change(sender):
            self._shares.renew(sender, self._shares.get(sender) or {}, now)

    def share(self, sender: Sender) -> Sender:
        """Under whom he counts: himself, OTHERS or STRANGERS."""
        if sender in self._shares:
            return sender
        return OTHERS if self.may_change(sender) else STRANGERS

    def outranks(self, sender: Sender, other: Sender) -> bool:
        """Whether `sender` has more right to what is scarce: by a share of his own, or by what he may do."""
        return self._rank(sender) > self._rank(other)

    def admits(self, sender: Sender, now: float, *, kind: str = "") -> bool:
        """Count one request of `sender`, who was heard; False beyond his share: 20 a second after 60 at once.

        All who may only read have 5 a second after 20. kind: of requests that are counted apart, so that a
        download does not keep an answer out.
        """
        share = self.share(sender)
        buckets = self._shares.get(share)
        if buckets is None:
            buckets = self._common[share]
        if kind not in buckets:
            buckets[kind] = (
                TokenBucket(STRANGERS_PER_SECOND, STRANGERS_AT_ONCE, now)
                if share == STRANGERS
                else TokenBucket(REQUESTS_PER_SECOND, REQUESTS_AT_ONCE, now)
            )
        if buckets[kind].take(1, now):
            return True
        self.rejected["rate"] += 1
        return False

    def _rank(self, sender: Sender) -> int:
        return (sender in self._shares) + self.may_change(sender)
