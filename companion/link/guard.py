"""Who may ask, how often, and what was turned away."""

from __future__ import annotations

from collections import Counter, OrderedDict
from typing import Any

from companion.link.bucket import TokenBucket
from companion.link.heard import Sender
from companion.link.signing import Signing
from companion.wire.refusals import Rejected

REQUESTS_PER_SECOND = 20.0
REQUESTS_AT_ONCE = 60.0
STRANGERS_PER_SECOND = 5.0
STRANGERS_AT_ONCE = 20.0
MAX_SENDERS = 32
STRANGERS: Sender = (0, 0)
"""Who may only read counts as one: under many names nobody gets more than his share."""


class Guard:
    """Signatures, the allow-list and each sender's rate. `rejected` counts by reason."""

    def __init__(self, allowed: tuple[int, int], signing: Signing | None = None) -> None:
        self._allowed = allowed
        self._signing = signing
        self._rates: OrderedDict[tuple[Sender, str], TokenBucket] = OrderedDict()
        self.rejected: Counter[Rejected] = Counter()

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

    def admits(self, sender: Sender, now: float, *, kind: str = "") -> bool:
        """Count one request of `sender`; False beyond 20 a second after the first 60.

        All who may only read have 5 a second after 20, together. kind: of requests that are counted apart, so
        that a download does not keep an answer out.
        """
        known = self.may_change(sender)
        key = (sender if known else STRANGERS, kind)
        if key not in self._rates:
            self._rates[key] = (
                TokenBucket(REQUESTS_PER_SECOND, REQUESTS_AT_ONCE, now)
                if known
                else TokenBucket(STRANGERS_PER_SECOND, STRANGERS_AT_ONCE, now)
            )
            if len(self._rates) > MAX_SENDERS:
                self._rates.popitem(last=False)
        self._rates.move_to_end(key)
        if self._rates[key].take(1, now):
            return True
        self.rejected["rate"] += 1
        return False
