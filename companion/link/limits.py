"""Bounds what other senders may use: bytes (TokenBucket) and places (LeaseTable)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Generic, TypeVar


class TokenBucket:
    """Lets at most `rate` x t + `burst` bytes pass in any t seconds. Rate 0: unlimited. Full at the start."""

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._level = burst
        self._at = now

    def affords(self, size: float, now: float) -> bool:
        """Whether `size` bytes may pass at `now`."""
        return self._rate == 0 or self._level_at(now) >= size

    def take(self, size: float, now: float) -> bool:
        """Take `size` bytes from the budget; False, and nothing taken, when they may not pass yet."""
        if not self.affords(size, now):
            return False
        if self._rate:
            self._level = self._level_at(now) - size
            self._at = max(now, self._at)
        return True

    def set_rate(self, rate: float, now: float) -> None:
        """Set the bytes per second from now on; the level stays."""
        self._level, self._at, self._rate = self._level_at(now), max(now, self._at), rate

    def _level_at(self, now: float) -> float:
        return min(self._burst, self._level + max(0.0, now - self._at) * self._rate)


_Holder = TypeVar("_Holder", bound=Hashable)
_Value = TypeVar("_Value")


class LeaseTable(Generic[_Holder, _Value]):
    """Stores at most `places` keys with a value each. A key keeps its place for `lasts` s after each renewal.

    So a sender that keeps changing its id cannot push others out: a new key waits for a free or expired
    place.
    """

    def __init__(self, places: int, lasts: float) -> None:
        self._places = places
        self._lasts = lasts
        self._leases: dict[_Holder, tuple[float, _Value]] = {}

    def __iter__(self) -> Iterator[_Holder]:
        return iter(self._leases)

    def __contains__(self, key: object) -> bool:
        return key in self._leases

    def get(self, key: _Holder) -> _Value | None:
        """The value of `key`; None when it has no place."""
        lease = self._leases.get(key)
        return None if lease is None else lease[1]

    def renew(self, key: _Holder, value: _Value, now: float) -> bool:
        """Renew the place of `key`, or give it a free or expired one, and set its value; False for none.

        now: s; minus infinity takes a free place only, which any other key may take over.
        """
        lease = self._leases.get(key)
        if lease is None and len(self._leases) >= self._places:
            stalest = min(self._leases, key=lambda other: self._leases[other][0])
            if not now - self._leases[stalest][0] > self._lasts:  # also where both are minus infinity
                return False
            del self._leases[stalest]
        self._leases[key] = (now if lease is None else max(now, lease[0])), value
        return True
