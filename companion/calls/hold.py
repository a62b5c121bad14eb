"""Tracks one hold of the vehicle from the first command to its end, and says which mode to command. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from anytraverse.assessment import Assessment
from companion.calls.held_mission import HeldMission
from companion.calls.numbers import Numbers
from companion.vehicle import Autopilot


class HoldState(str, Enum):
    """The state of a hold."""

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
    """The autopilot rebooted. Nobody took over, and the hold goes on."""
    MISSION_OVER = "mission over"
    """A resume was refused, since it would begin the mission anew. The hold stands, and waits for a human."""
    DROPPED = "dropped"
    """The policy allows no commands any more. The vehicle stays in its mode."""


@dataclass
class Hold:
    """A hold that the companion commanded.

    id: that of its call, where it has one. mode: the custom_mode that holds. mode_before: the mode to return
    to. started_at: monotonic seconds.
    tries: commands sent in this state. tried_at: when the last one was sent.
    failed: the autopilot did not follow after all tries; a human must act.
    only_fault: only faults caused it, so that it may end without a go where the configuration allows that. A
    hold whose resume failed needs a go.
    resume_cancelled_at: when a resume was cancelled last.
    rebooted: the autopilot rebooted and has not been armed since. No human chose the modes that it shows.
    seen: its first blocked frame, in which the operator may tap. None: not blocked yet, or it has a call.
    interrupted: the mission that it interrupted.
    """

    id: int
    mode: int
    mode_before: int
    started_at: float
    state: HoldState = HoldState.REQUESTED
    tries: int = 0
    tried_at: float = 0.0
    failed: bool = False
    only_fault: bool = True
    resume_cancelled_at: float | None = None
    rebooted: bool = False
    seen: Assessment | None = None
    interrupted: HeldMission = field(default_factory=HeldMission)

    @property
    def standing(self) -> bool:
        """Whether the autopilot has confirmed the hold."""
        return self.state is not HoldState.REQUESTED

    @property
    def wanted_mode(self) -> int | None:
        """The mode to command in this state, None while the hold stands."""
        return {
            HoldState.REQUESTED: self.mode,
            HoldState.STANDING: None,
            HoldState.RESUMING: self.mode_before,
        }[self.state]

    def enter(self, state: HoldState) -> None:
        """Change to another state, and start counting tries again."""
        self.state, self.tries, self.failed = state, 0, False

    def cancel_resume(self, now: float) -> None:
        """Hold again while a resume is under way: the autopilot may already have changed back."""
        self.enter(HoldState.REQUESTED)
        self.resume_cancelled_at = now

    def request_again(self) -> None:
        """Request the hold again after the autopilot rebooted. From now on it needs a go to end."""
        self.enter(HoldState.REQUESTED)
        self.rebooted, self.only_fault = True, False

    def needs_lead(self, autopilot: Autopilot | None, now: float) -> bool:
        """Whether setpoints must be streamed for longer before the mode that holds is commanded."""
        if autopilot is None or self.mode not in autopilot.streamed:
            return False
        return now - self.started_at < autopilot.lead

    def adopt_rest_mode(self, mode: int | None, autopilot: Autopilot | None) -> None:
        """Adopt the rest mode where the autopilot changed to it because our setpoints stopped."""
        if autopilot is not None and self.mode in autopilot.streamed and mode == autopilot.rest_mode:
            self.mode = autopilot.rest_mode

    def tick(self, now: float, numbers: Numbers) -> tuple[int | None, HoldEvent | None]:
        """Return the mode to command now, if any, and FAILED once when all tries are used up."""
        wanted = self.wanted_mode
        pause = numbers.mode_retry_failed if self.failed else numbers.mode_retry
        if wanted is None or (self.tries and now - self.tried_at < pause):
            return None, None
        event = None
        if self.tries == numbers.mode_tries and not self.failed:
            event = HoldEvent.FAILED
            if self.state is HoldState.RESUMING:
                # The vehicle still stands: give up the resume, and wait for a new go.
                self.enter(HoldState.STANDING)
                return None, event
            self.failed = True
        self.tries += 1
        self.tried_at = now
        return wanted, event

    def mode_reported(self, mode: int, now: float, numbers: Numbers) -> HoldEvent | None:
        """Take in the mode that the vehicle reports, and return what that means for the hold.

        A mode that we did not command was set by a human, who always wins.
        """
        if mode == self.mode:
            if self.state is HoldState.REQUESTED:
                self.enter(HoldState.STANDING)
                return HoldEvent.CONFIRMED
            return None
        if mode != self.mode_before:
            return HoldEvent.TAKEN_OVER
        if self.state is HoldState.RESUMING:
            return HoldEvent.RESUMED
        if self.state is HoldState.REQUESTED:
            return None
        # The autopilot may carry out our cancelled resume late: that is not a human who takes over.
        if self.resume_cancelled_at is None or now - self.resume_cancelled_at > numbers.mode_settles:
            return HoldEvent.TAKEN_OVER
        self.enter(HoldState.REQUESTED)
        return None


@dataclass
class OffboardRelease:
    """Ends a hold that stands on our setpoints: commands `rest` while the setpoints are still streamed.

    Without that the autopilot's offboard-loss fail-safe would act. streamed: the mode of the hold. before:
    the mode before the hold. Any mode but these two ends the release.
    """

    streamed: int
    rest: int
    before: int
    since: float
    tries: int = 0
    tried_at: float = 0.0

    @staticmethod
    def of(hold: Hold, autopilot: Autopilot | None, now: float) -> OffboardRelease | None:
        """Return the release that `hold` needs, None where its mode needs no setpoints."""
        if autopilot is None or hold.mode not in autopilot.streamed:
            return None
        return OffboardRelease(hold.mode, autopilot.rest_mode, hold.mode_before, now)

    def over(self, mode: int | None, now: float, numbers: Numbers) -> bool:
        """Whether the setpoints may end.

        While the mode before the hold is shown, the command to hold may still be on its way: wait.
        """
        if mode == self.before:
            return now - self.since > numbers.mode_settles
        return mode != self.streamed

    def tick(self, mode: int | None, now: float, numbers: Numbers) -> int | None:
        """Return the mode to command now, if any: at once, and again until the autopilot shows it."""
        pause = numbers.mode_retry if self.tries <= numbers.mode_tries else numbers.mode_retry_failed
        if mode != self.streamed or (self.tries and now - self.tried_at < pause):
            return None
        self.tries, self.tried_at = self.tries + 1, now
        return self.rest
