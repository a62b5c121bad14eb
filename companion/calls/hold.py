"""One hold of the vehicle, from asking for it to its end. Pure: it says which mode to command."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from anytraverse.assessment import Assessment
from companion.calls.numbers import Numbers
from companion.vehicle import Autopilot


class HoldStage(str, Enum):
    """Where a hold stands."""

    REQUESTED = "requested"
    STANDING = "standing"
    RESUMING = "resuming"


class HoldEvent(Enum):
    """What happened to a hold."""

    CONFIRMED = "confirmed"
    FAILED = "failed"
    TAKEN_OVER = "taken over"
    RESUMED = "resumed"
    REBOOTED = "rebooted"
    """The autopilot began anew: nobody took over, and the hold goes on."""
    DROPPED = "dropped"
    """We may not command any more; the vehicle stays as it is."""


@dataclass
class Hold:
    """A hold of ours.

    id: shared with the call it belongs to. mode: custom_mode that holds. mode_before: the one to go back to.
    failed: the autopilot did not follow after all tries; a human must act.
    only_fault: nothing but a fault ever asked for it, so that it may end without a go; one whose way back
    failed needs one.
    rebooted: the autopilot began anew, and nobody has armed it since: the modes that it shows are nobody's.
    seen: the first frame of it that was blocked, which can be tapped in; None: not blocked yet, or a call's.
    """

    id: int
    mode: int
    mode_before: int
    started_at: float
    stage: HoldStage = HoldStage.REQUESTED
    tries: int = 0
    tried_at: float = 0.0
    failed: bool = False
    only_fault: bool = True
    called_back_at: float | None = None
    rebooted: bool = False
    seen: Assessment | None = None

    @property
    def standing(self) -> bool:
        """The vehicle stands because of us."""
        return self.stage is not HoldStage.REQUESTED

    @property
    def wanted_mode(self) -> int | None:
        """The mode that the vehicle should be in by our command, None while it stands as it should."""
        return {
            HoldStage.REQUESTED: self.mode,
            HoldStage.STANDING: None,
            HoldStage.RESUMING: self.mode_before,
        }[self.stage]

    def turn(self, stage: HoldStage) -> None:
        """Start to work for another stage, with all tries."""
        self.stage, self.tries, self.failed = stage, 0, False

    def call_back(self, now: float) -> None:
        """Hold again after all, while the way back may already have been taken."""
        self.turn(HoldStage.REQUESTED)
        self.called_back_at = now

    def begin_anew(self) -> None:
        """The autopilot rebooted: the vehicle does not stand by our doing now, and drives on only by a go."""
        self.turn(HoldStage.REQUESTED)
        self.rebooted, self.only_fault = True, False

    def needs_lead(self, autopilot: Autopilot | None, now: float) -> bool:
        """Whether zero velocity was not streamed for long enough yet to ask for the mode that holds."""
        if autopilot is None or self.mode not in autopilot.streamed:
            return False
        return now - self.started_at < autopilot.lead

    def found_at_rest(self, mode: int | None, autopilot: Autopilot | None) -> None:
        """The autopilot, left or found without our setpoints, may have gone to stand by itself."""
        if autopilot is not None and self.mode in autopilot.streamed and mode == autopilot.rest_mode:
            self.mode = autopilot.rest_mode

    def tick(self, now: float, numbers: Numbers) -> tuple[int | None, HoldEvent | None]:
        """The mode to command now, if any, and FAILED once when the last try is over."""
        wanted = self.wanted_mode
        pause = numbers.mode_retry_failed if self.failed else numbers.mode_retry
        if wanted is None or (self.tries and now - self.tried_at < pause):
            return None, None
        event = None
        if self.tries == numbers.mode_tries and not self.failed:
            event = HoldEvent.FAILED
            if self.stage is HoldStage.RESUMING:
                self.turn(HoldStage.STANDING)
                return None, event
            self.failed = True
        self.tries += 1
        self.tried_at = now
        return wanted, event

    def vehicle(self, mode: int, now: float, numbers: Numbers) -> HoldEvent | None:
        """The mode that the vehicle shows. Any mode that we did not ask for is a human's, who wins."""
        if mode == self.mode:
            if self.stage is HoldStage.REQUESTED:
                self.turn(HoldStage.STANDING)
                return HoldEvent.CONFIRMED
            return None
        if mode != self.mode_before:
            return HoldEvent.TAKEN_OVER
        if self.stage is HoldStage.RESUMING:
            return HoldEvent.RESUMED
        if self.stage is HoldStage.REQUESTED:
            return None
        if self.called_back_at is None or now - self.called_back_at > numbers.mode_settles:
            return HoldEvent.TAKEN_OVER
        self.turn(HoldStage.REQUESTED)
        return None


@dataclass
class OffboardRelease:
    """From `streamed`, the mode of a hold that is given up, to `rest`. A mode that is neither ends it."""

    streamed: int
    rest: int
    before: int
    since: float
    tries: int = 0
    tried_at: float = 0.0

    @staticmethod
    def of(hold: Hold, autopilot: Autopilot | None, now: float) -> OffboardRelease | None:
        """What giving up `hold` needs: None where nothing is streamed."""
        if autopilot is None or hold.mode not in autopilot.streamed:
            return None
        return OffboardRelease(hold.mode, autopilot.rest_mode, hold.mode_before, now)

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
