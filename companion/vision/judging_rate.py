"""Lowers the rate at which frames are judged while this computer is too slow or too hot. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from statistics import median
from typing import Any

from companion.system.computer import WARM

_SHARES = (1.0, 3 / 4, 1 / 2)
_LOWEST = 1 / 3
"""Shares of [camera] rate."""
_WITHIN_T = 3.0
"""Frames within T that every step judges at least, unless [camera] rate itself is lower."""
_APART = 1.01
"""Rates that differ by less than this factor are one step."""
EASY = 0.75
"""Share of the time from one frame to the next that judging may take at a rate, for a step up to it."""
_OVER = 2.0
"""Seconds of [camera] rate, over whose frames the median of the times of judging is taken."""
_COOLER = 5.0
"""Degrees Celsius below `WARM` at which a hot computer counts as cool again."""
STRAINED_FOR = 10.0
"""Seconds of heat or throttling before each step down."""
CALM_FOR, LONGEST_CALM = 20.0, 320.0
"""Seconds of calm before each step up. They double, up to the second, when a step up did not last so long."""


def steps(rate: float, freshness: float, window: int) -> tuple[float, ...]:
    """Return the rates in frames/s, falling from the configured one.

    freshness: the limit T, s. window: the frames that votes are counted over. They and a frame's judging fit
    into T at each rate but the configured one: so a thing is noticed no later than `judge_stopping` assumes.
    """
    least = max(_LOWEST * rate, max(_WITHIN_T, window + 1.0) / freshness)
    higher = tuple(share * rate for share in _SHARES if share * rate > _APART * least)
    return (*higher, least) if higher else (rate,)


class JudgingRate:
    """Decides how many frames a second are judged. T does not change with it. Time is an input.

    steps: all rates, see the function. value: the one in force. why: "slow computer", "hot computer" or
    "throttled computer", whichever lowered it last; "" at the configured rate. stuck: "hot computer" or
    "throttled computer" since no step was left that could help, until a step up, or long calm; "" otherwise.
    """

    def __init__(self, rate: float, freshness: float, window: int) -> None:
        self.steps = steps(rate, freshness, window)
        self.why = self.stuck = ""
        self._step = 0
        self._times: deque[float] = deque(maxlen=max(5, math.ceil(_OVER * rate)))
        self._hot = self._under_strain = self._calm = False
        self._since = 0.0
        """When the strain or the calm of now began, or the last step was taken."""
        self._calm_for = CALM_FOR
        self._rose_at: float | None = None
        """When the last step was taken, if it was a step up."""

    @property
    def value(self) -> float:
        """Frames/s that are judged now."""
        return self.steps[self._step]

    def judged(self, seconds: float) -> None:
        """Take note of a judged frame. seconds: of judging it."""
        self._times.append(seconds)

    def tick(self, now: float, computer: Mapping[str, Any]) -> None:
        """Take a step down or up where it is time. computer: figures as of `Computer.measure`."""
        taken = median(self._times) if len(self._times) == self._times.maxlen else None
        lowest = self._step == len(self.steps) - 1
        if taken is not None and taken > 1.0 / self.value and not lowest:
            fits = (step for step, rate in enumerate(self.steps) if taken <= 1.0 / rate)
            self._fall(next(fits, len(self.steps) - 1), "slow computer", now)
        strain = self._strained(computer)
        higher = self.steps[max(0, self._step - 1)]
        calm = not strain and self._step > 0 and taken is not None and taken <= EASY / higher
        if (bool(strain), calm) != (self._under_strain, self._calm):
            self._under_strain, self._calm, self._since = bool(strain), calm, now
        if not strain and now - self._since >= LONGEST_CALM:
            self.stuck = ""
        if strain and now - self._since >= STRAINED_FOR:
            if self._step < len(self.steps) - 1:
                self._fall(self._step + 1, strain, now)
            else:
                self.stuck = self.stuck or strain
        elif calm and now - self._since >= self._calm_for:
            self._rise(now)

    def _strained(self, computer: Mapping[str, Any]) -> str:
        degrees = computer.get("temperature")
        self._hot = degrees is not None and degrees >= WARM - (_COOLER if self._hot else 0.0)
        if computer.get("throttled"):
            return "throttled computer"
        return "hot computer" if self._hot else ""

    def _fall(self, step: int, why: str, now: float) -> None:
        if self._rose_at is not None:
            relapse = now - self._rose_at < LONGEST_CALM
            self._calm_for = min(2.0 * self._calm_for, LONGEST_CALM) if relapse else CALM_FOR
        self._take(step, why, now)
        self._rose_at = None

    def _rise(self, now: float) -> None:
        self._take(self._step - 1, self.why if self._step > 1 else "", now)
        self._rose_at, self.stuck = now, ""

    def _take(self, step: int, why: str, now: float) -> None:
        self._step, self.why, self._since = step, why, now
        self._calm = False
        self._times.clear()
