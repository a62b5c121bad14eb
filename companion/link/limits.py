"""Bounds on what others may cause: byte budgets, places for senders, the newest entries of each."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Any, Generic, TypeVar

from companion.link.inbound import Sender


class TokenBucket:
    """Over any t seconds at most `rate` x t + `burst` bytes pass. Rate 0: unlimited. Full at the start."""

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._level = burst
        self._at = now

    def affords(self, size: float, now: float) -> bool:
        """Whether `size` bytes may pass at `now`."""
        return self._rate == 0 or self._filled(now) >= size

    def take(self, size: float, now: float) -> bool:
        """Let `size` bytes pass, or say that they may not yet."""
        if not self.affords(size, now):
            return False
        if self._rate:
            self._level = self._filled(now) - size
            self._at = max(now, self._at)
        return True

    def set_rate(self, rate: float, now: float) -> None:
        """Bytes per second from now on; what has gathered stays."""
        self._level, self._at, self._rate = self._filled(now), max(now, self._at), rate

    def _filled(self, now: float) -> float:
        return min(self._burst, self._level + max(0.0, now - self._at) * self._rate)


_Holder = TypeVar("_Holder", bound=Hashable)
_Value = TypeVar("_Value")


class LeaseTable(Generic[_Holder, _Value]):
    """At most `places` keys, each with a value. A key keeps its place for `lasts` s after it was renewed.

    So rotating keys gain nothing: they wait until a place is free, or its key silent.
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
        """The value that `key` has; None when it has no place."""
        lease = self._leases.get(key)
        return None if lease is None else lease[1]

    def renew(self, key: _Holder, value: _Value, now: float) -> bool:
        """Whether `key` has a place now, which then has this value.

        now: s; minus infinity takes a free place only, and leaves it to whoever comes next.
        """
        lease = self._leases.get(key)
        if lease is None and len(self._leases) >= self._places:
            stalest = min(self._leases, key=lambda other: self._leases[other][0])
            if not now - self._leases[stalest][0] > self._lasts:  # also where both are minus infinity
                return False
            del self._leases[stalest]
        self._leases[key] = (now if lease is None else max(now, lease[0])), value
        return True


_Key = tuple[Any, ...]
_T = TypeVar("_T")


class SenderCache(Generic[_T]):
    """The newest 64 of each sender, whom a key begins with: nobody pushes out another's. 1024 in all."""

    def __init__(self, of_a_sender: int = 64, in_all: int = 1024) -> None:
        self._of_a_sender, self._in_all = of_a_sender, in_all
        self._entries: dict[_Key, _T] = {}
        self._counts: dict[Sender, int] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def get(self, key: _Key) -> _T | None:
        """What was put there last; None when it is not known."""
        return self._entries.get(key)

    def put(self, key: _Key, value: _T) -> None:
        """`key` is the newest now."""
        self.pop(key)
        self._entries[key] = value
        own = self._counts[key[0]] = self._counts.get(key[0], 0) + 1
        if own > self._of_a_sender:
            self.pop(next(one for one in self._entries if one[0] == key[0]))
        elif len(self._entries) > self._in_all:
            self.pop(next(iter(self._entries)))

    def pop(self, key: _Key) -> None:
        """Forget it, if it is known."""
        if self._entries.pop(key, None) is not None:
            self._counts[key[0]] -= 1
            if not self._counts[key[0]]:
                del self._counts[key[0]]
