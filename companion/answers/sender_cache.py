"""Bounds what is stored for each sender, so that nobody pushes out what is stored for another."""

from __future__ import annotations

from collections.abc import Hashable, ItemsView
from typing import Any, Generic, TypeVar

_Key = tuple[Any, ...]
_T = TypeVar("_T")


class SenderCache(Generic[_T]):
    """Stores the newest entries of each sender, up to a number of each and in all.

    A key is a tuple that begins with the sender, or with what else the first bound counts by.
    """

    def __init__(self, of_a_sender: int, in_all: int) -> None:
        self._of_a_sender, self._in_all = of_a_sender, in_all
        self._entries: dict[_Key, _T] = {}
        self._counts: dict[Hashable, int] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def items(self) -> ItemsView[_Key, _T]:
        """All keys and values, the oldest first."""
        return self._entries.items()

    def get(self, key: _Key) -> _T | None:
        """The value of `key`; None when there is none."""
        return self._entries.get(key)

    def put(self, key: _Key, value: _T) -> None:
        """Store `value` as the newest entry; above a limit, drop the oldest of its sender, or of all."""
        self.pop(key)
        self._entries[key] = value
        own = self._counts[key[0]] = self._counts.get(key[0], 0) + 1
        if own > self._of_a_sender:
            self.pop(next(one for one in self._entries if one[0] == key[0]))
        elif len(self._entries) > self._in_all:
            self.pop(next(iter(self._entries)))

    def pop(self, key: _Key) -> None:
        """Remove `key`, if it is stored."""
        if self._entries.pop(key, None) is not None:
            self._counts[key[0]] -= 1
            if not self._counts[key[0]]:
                del self._counts[key[0]]
