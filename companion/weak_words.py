"""Which words that come into use the perceiver finds badly: a tap teaches it better than the name."""

from __future__ import annotations

from collections.abc import Iterable


class WeakWords:
    """Tells each weak word once when it comes into use, and again only after it was out of use."""

    def __init__(self) -> None:
        self._told: frozenset[str] = frozenset()

    def new(self, weak: Iterable[str], words: Iterable[str]) -> list[str]:
        """The weak ones of the `words` in use that were not told since they came into use."""
        new = [word for word in weak if word not in self._told]
        self._told = (self._told | frozenset(weak)) & frozenset(words)
        return new
