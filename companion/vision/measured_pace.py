"""Follows how long frames take to be judged, for the check whether the vehicle may be held. Pure."""

from __future__ import annotations

from collections import deque
from statistics import median_high

BAD_FOR, GOOD_FOR = 5.0, 10.0
"""Seconds for which frames must have been slower, or quicker, before that counts."""
_OF = 3
"""Frames whose median is taken: neither one slow frame nor one quick frame counts."""


class MeasuredPace:
    """Seconds that a frame takes. Time is an input.

    step: what counts for a hold that is in force. It rises to what every frame of `BAD_FOR` seconds took at
    least, and falls to what every frame of `GOOD_FOR` seconds took at most; 0 at first. newest: the median of
    the newest frames, at first what warming up took; it counts for a request.
    """

    def __init__(self, scene_every: int) -> None:
        """scene_every: frames from one embedding of the scene to the next; the slowest of them counts."""
        self.step = self.newest = 0.0
        self._cycle: deque[float] = deque(maxlen=scene_every)
        self._frames: deque[tuple[float, float]] = deque(maxlen=_OF)
        """When the newest frames began, and how long they took with an embedding of the scene."""
        self._since: deque[tuple[float, float]] = deque(maxlen=1000)
        """From when on frames took how long, of the last `GOOD_FOR` seconds."""

    def started(self, step: float, now: float) -> None:
        """Begin anew after a start of the perceiver. step: what warming up took. What counts stays."""
        for known in (self._cycle, self._frames, self._since):
            known.clear()
        self._frames.append((now, step))
        self._since.append((now, step))
        self.newest = step

    def judged(self, seconds: float, at: float) -> None:
        """Take in a frame that took `seconds` to judge, until `at`."""
        self._cycle.append(seconds)
        before = self._frames[-1][0] if self._frames else at - seconds
        self._frames.append((at - seconds, max(self._cycle)))
        self.newest = median_high(taken for _, taken in self._frames)
        # A median changes with the second frame of a kind, and holds since the first of them began.
        self._since.append((before, self.newest))
        while len(self._since) > 1 and self._since[1][0] <= at - GOOD_FOR:
            self._since.popleft()
        self.step = min(max(self.step, self._least(at)), self._most(at))

    def _least(self, at: float) -> float:
        """Return what every frame took at least for `BAD_FOR` seconds, 0 where that is not known."""
        if self._since[0][0] > at - BAD_FOR:
            return 0.0
        ends = [*(began for began, _ in self._since), at][1:]
        return min(taken for (_, taken), end in zip(self._since, ends, strict=True) if end > at - BAD_FOR)

    def _most(self, at: float) -> float:
        """Return what every frame took at most for `GOOD_FOR` seconds, infinite where that is not known."""
        if self._since[0][0] > at - GOOD_FOR:
            return float("inf")
        return max(taken for _, taken in self._since)
