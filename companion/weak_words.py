"""Which words that come into use the perceiver finds badly: a tap teaches it better than the name."""

from __future__ import annotations

from collections.abc import Callable

from anytraverse.errors import UnknownWordError
from anytraverse.memory import Memory
from anytraverse.perception import WEAK

Trust = Callable[[str], str]
"""How far a word can be trusted, as a perceiver with a `trust` says it. Raises UnknownWordError."""


class WeakWords:
    """Tells each weak word once when it comes into use, and again only after it was out of use."""

    def __init__(self, trust: Trust | None) -> None:
        """trust: None for a perceiver that says nothing of its words."""
        self._trust = trust
        self._in_use: frozenset[str] = frozenset()

    def new(self, memory: Memory) -> list[str]:
        """The weak words in use that were not before, and that no tap explains."""
        before, self._in_use = self._in_use, frozenset(memory.preferences)
        return [
            word
            for word in memory.preferences
            if word not in before and word not in memory.examples and self._is_weak(word)
        ]

    def _is_weak(self, word: str) -> bool:
        try:
            return self._trust is not None and self._trust(word) == WEAK
        except UnknownWordError:
            return False
