"""Calculates how the vehicle leans against the ground on which it stands, at the time of a frame.

ATTITUDE counts from the horizon. A slope leans vehicle and ground alike, and the camera sees the ground as
before; a swing or a bump leans only the vehicle. So the slow part of the angles is taken out by a high-pass
filter of the first order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

SETTLES = 1.0
"""Seconds: the filter's time constant. Of a rover's swing, at 0.7 Hz, 98 % pass, 13 degrees early.

With less the swing is told worse, with more a slope that begins is taken for it: docs/ground.md has figures.
"""
LONGEST_GAP = 2.0
"""Seconds without a report after which the filter starts anew."""
NEAR_ENOUGH = 0.3
"""Seconds between a frame and the nearest report, at most: reports come every 0.25 s."""

LARGEST_LEAN = 45.0
"""Degrees. A vehicle that leans by more lies on its side: where the ground is, is not known then."""


class Lean(NamedTuple):
    """How the vehicle leans, degrees: nose up and right side down are positive.

    at: seconds of the link's monotonic clock. pitch_rate, bank_rate: degrees/s.
    """

    at: float
    pitch: float
    bank: float
    pitch_rate: float
    bank_rate: float


class LeanFilter:
    """Takes the slow part out of the reported angles."""

    def __init__(self) -> None:
        self._at = -math.inf
        self._slow = (0.0, 0.0)

    def take(self, at: float, angles: tuple[float, float], rates: tuple[float, float] = (0.0, 0.0)) -> Lean:
        """Take pitch and bank in degrees, and their rates; return how the vehicle leans.

        The first report after a gap says nothing about the ground: the vehicle counts as not leaning.
        """
        passed, self._at = at - self._at, at
        follows = 1.0 - math.exp(-passed / SETTLES) if 0.0 <= passed <= LONGEST_GAP else 1.0
        slow = [slow + follows * (angle - slow) for slow, angle in zip(self._slow, angles, strict=True)]
        self._slow = (slow[0], slow[1])
        return Lean(at, angles[0] - slow[0], angles[1] - slow[1], *rates)


def lean_at(reports: Iterable[Lean], at: float) -> tuple[float, float] | None:
    """Return pitch and bank at a time from the nearest report and its rate; None where none is near."""
    nearest = min(reports, key=lambda report: abs(report.at - at), default=None)
    if nearest is None or abs(nearest.at - at) > NEAR_ENOUGH:
        return None
    since = at - nearest.at
    pitch, bank = nearest.pitch + since * nearest.pitch_rate, nearest.bank + since * nearest.bank_rate
    return (pitch, bank) if max(abs(pitch), abs(bank)) <= LARGEST_LEAN else None
