"""Leaving a hold that stands only on our setpoints: the autopilot must stand by itself before they end."""

from __future__ import annotations

from dataclasses import dataclass

from companion.autopilots import Autopilot
from companion.calls.hold import Hold
from companion.calls.numbers import Numbers


@dataclass
class Handover:
    """From `streamed`, the mode of a hold that is given up, to `rest`. A mode that is neither ends it."""

    streamed: int
    rest: int
    before: int
    since: float
    tries: int = 0
    tried_at: float = 0.0

    @staticmethod
    def of(hold: Hold, autopilot: Autopilot | None, now: float) -> Handover | None:
        """What giving up `hold` needs: None where nothing is streamed."""
        if autopilot is None or hold.mode not in autopilot.streamed:
            return None
        return Handover(hold.mode, autopilot.rest_mode, hold.mode_before, now)

    def over(self, mode: int | None, now: float, numbers: Numbers) -> bool:
        """Whether the setpoints may end. A hold that was asked for just now may still be on its way."""
        if mode == self.before:
            return now - self.since > numbers.mode_settles
        return mode != self.streamed

    def tick(self, mode: int | None, now: float, numbers: Numbers) -> int | None:
        """The mode to command now, if any: at once, and again until it shows."""
        pause = numbers.mode_retry if self.tries <= numbers.mode_tries else numbers.mode_retry_failed
        if mode != self.streamed or (self.tries and now - self.tried_at < pause):
            return None
        self.tries, self.tried_at = self.tries + 1, now
        return self.rest
