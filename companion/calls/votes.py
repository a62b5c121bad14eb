"""Debounce and hysteresis of one reason."""

from __future__ import annotations

from collections import deque


class Votes:
    """Active after `needed` bad frames of the last `window`; ends after as many clear ones."""

    def __init__(self, needed: int, window: int) -> None:
        self._needed = needed
        self._frames: deque[tuple[bool, bool]] = deque(maxlen=window)
        self.active = False

    def add(self, *, bad: bool, clear: bool) -> None:
        """One more frame; between bad and clear it votes for neither."""
        self._frames.append((bad, clear))
        if sum(bad for bad, _ in self._frames) >= self._needed:
            self.active = True
        elif sum(clear for _, clear in self._frames) >= self._needed:
            self.active = False

    def amend(self, *, bad: bool, clear: bool) -> None:
        """The newest frame votes anew, not twice."""
        if self._frames:
            self._frames.pop()
        self.add(bad=bad, clear=clear)

    def reset(self) -> None:
        """Inactive, with nothing remembered."""
        self._frames.clear()
        self.active = False
