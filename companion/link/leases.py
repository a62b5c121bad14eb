"""Places for whoever is heard: newcomers do not displace those who were there before and still speak."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Generic, TypeVar

_Key = TypeVar("_Key", bound=Hashable)
_Value = TypeVar("_Value")


class Leases(Generic[_Key, _Value]):
    """At most `places` keys, each with a value. A key keeps its place for `lasts` s after it was renewed.

    So rotating keys gain nothing: they wait until a place is free, or its key silent.
    """

    def __init__(self, places: int, lasts: float) -> None:
        self._places = places
        self._lasts = lasts
        self._held: dict[_Key, tuple[float, _Value]] = {}

    def __iter__(self) -> Iterator[_Key]:
        return iter(self._held)

    def __contains__(self, key: object) -> bool:
        return key in self._held

    def get(self, key: _Key) -> _Value | None:
        """The value that `key` has; None when it has no place."""
        held = self._held.get(key)
        return None if held is None else held[1]

    def renew(self, key: _Key, value: _Value, now: float) -> bool:
        """Whether `key` has a place now, which then has this value.

        now: s; minus infinity takes a free place only, and leaves it to whoever comes next.
        """
        held = self._held.get(key)
        if held is None and len(self._held) >= self._places:
            silent = min(self._held, key=lambda other: self._held[other][0])
            if not now - self._held[silent][0] > self._lasts:  # also where both are minus infinity
                return False
            del self._held[silent]
        self._held[key] = (now if held is None else max(now, held[0])), value
        return True
