"""Lists that are told one value at a time, so that they never fill a queue; on each connection by itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from companion.link.heard import Sender
from companion.link.outbox import Outbox


@dataclass
class _Round:
    """A list on one connection: who asked last, what is next, how many are left."""

    to: Sender
    at: int = 0
    left: int = 0


class Rounds:
    """Whoever asks while a list is told gets it round once from there: two on a connection cost one list."""

    def __init__(self, outbox: Outbox, row: str, count: int) -> None:
        """row: of the message table. count: values in the list."""
        self._outbox = outbox
        self._row = row
        self._count = count
        self._rounds: dict[str, _Round] = {}

    def begin(self, sender: Sender) -> None:
        """`sender` asks for all."""
        channel = self._outbox.channel(sender)
        if channel is not None:
            told = self._rounds.setdefault(channel.name, _Round(sender))
            told.to, told.left = sender, self._count

    def due(self) -> Iterator[tuple[int, Sender]]:
        """Index and receiver of what is to be told now: the next one where none of the row waits."""
        for told in self._rounds.values():
            if told.left and not self._outbox.waiting(self._row, told.to):
                yield told.at, told.to
                told.at = (told.at + 1) % self._count
                told.left -= 1
