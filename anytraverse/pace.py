"""Calculates whether frames are judged fast enough for the hold policy."""

from __future__ import annotations

from dataclasses import dataclass

_ROUNDING = 1e-6


@dataclass(frozen=True)
class Pace:
    """Holds how fast frames are judged, in seconds.

    step: a whole step, from the frame to its assessment, with an embedding of the scene.
    period: between two frames that should be judged. freshness: the limit T, after which a frame is too old.
    """

    step: float
    period: float
    freshness: float

    @property
    def rate(self) -> float:
        """Frames that are judged a second."""
        return 1.0 / max(self.step, self.period)

    @property
    def worst_age(self) -> float:
        """The greatest age of the newest judged frame, in seconds: two steps and a period.

        A frame waits while the one before it is judged, but at most one period, since then a newer frame
        replaces it: min(step, period). Judging it takes one step. Its assessment is the newest one until the
        next frame is judged: max(step, period).
        """
        return 2.0 * self.step + self.period

    @property
    def keeps(self) -> bool:
        """Whether each judged frame is replaced by a newer one before it is too old.

        If not, frames that are too old would hold the vehicle again and again: the hold policy is refused.
        With T at three periods, this holds when a step takes at most one period.
        """
        return self.worst_age <= self.freshness + _ROUNDING
