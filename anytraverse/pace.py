"""Whether frames are judged fast enough for a vehicle to be held by what they show."""

from __future__ import annotations

from dataclasses import dataclass

_ROUNDING = 1e-6


@dataclass(frozen=True)
class Pace:
    """How fast frames are judged. Seconds.

    step: a whole step, from the frame to its assessment, with an embedding of the scene.
    period: between two frames that should be judged. freshness: the limit T, after which a view is too old.
    """

    step: float
    period: float
    freshness: float

    @property
    def worst_age(self) -> float:
        """How old the newest view becomes: two steps and a period.

        A frame waits while the one before it is judged, but no longer than a period, since then a newer one
        has come: min(step, period). Then it is judged: step. What it showed is all that is known until the
        next one is judged: max(step, period).
        """
        return 2.0 * self.step + self.period

    @property
    def keeps(self) -> bool:
        """Whether a view is replaced before it is too old, frame after frame.

        Where not, a vehicle would be held by faults that are none of the trail's: it may not be held at all.
        With T at three periods it says that a step must fit into a period.
        """
        return self.worst_age <= self.freshness + _ROUNDING
