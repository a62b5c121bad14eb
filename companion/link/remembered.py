"""What became of the newest wishes, so that one that comes again is known."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from companion.link.heard import Sender

_Key = tuple[Any, ...]
_T = TypeVar("_T")


class Remembered(Generic[_T]):
    """The newest 64 of each sender, whom a key begins with: nobody pushes out another's. 1024 in all."""

    def __init__(self, of_a_sender: int = 64, in_all: int = 1024) -> None:
        self._of_a_sender, self._in_all = of_a_sender, in_all
        self._kept: dict[_Key, _T] = {}
        self._counts: dict[Sender, int] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def get(self, key: _Key) -> _T | None:
        """What was put there last; None when it is not known."""
        return self._kept.get(key)

    def put(self, key: _Key, value: _T) -> None:
        """`key` is the newest now."""
        self.pop(key)
        self._kept[key] = value
        own = self._counts[key[0]] = self._counts.get(key[0], 0) + 1
        if own > self._of_a_sender:
            self.pop(next(one for one in self._kept if one[0] == key[0]))
        elif len(self._kept) > self._in_all:
            self.pop(next(iter(self._kept)))

    def pop(self, key: _Key) -> None:
        """Forget it, if it is known."""
        if self._kept.pop(key, None) is not None:
            self._counts[key[0]] -= 1
            if not self._counts[key[0]]:
                del self._counts[key[0]]
