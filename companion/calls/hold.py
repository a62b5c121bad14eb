"""Tracks one hold of the vehicle from the first command to its end, and says which mode to command. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from anytraverse.assessment import Assessment
from companion.calls.mode_monitor import HeldMission, ModeAnswer, ModeReport
from companion.calls.numbers import Numbers
from companion.vehicle import Autopilot
from companion.vehicle.ardupilot import LONGEST_BRAKE

_REPORT_LAG = 0.25
_RESUME_SHOWS_LATER = 0.5
"""s beside the round trip in which a resume is shown."""
_BRAKE_LATER = 2.0
"""s beside the round trip that a brake may show later than it can last: its request may wait on the way."""
_CROSSED = 1.0
"""s after a hold began in which a change of mode for guiding may still show, as the script allows it, too."""
_LATE_REPORT_LAG = 1.2
"""Seconds after which a mode is shown: at once by HEARTBEAT, or late, see `Autopilot.reports_mode_late`."""


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
    commanded_as: the id when it began, by which the autopilot's script knows it; 0: `id`.
    tries: commands sent in this state. commanded_at, tried_at: when the first and the last one were sent.
    failed: the autopilot did not follow after all tries; a human must act.
    only_fault: only faults caused it, so that it may end without a go where the configuration allows that. A
    hold whose resume failed needs a go.
    resumed_at: when the resume was commanded that may still be under way, None without one.
    resume_taken: the autopilot has acknowledged that resume.
    held_at: when the autopilot acknowledged the newest command to hold, None before.
    may_brake_until: until when the mode in which the script brakes may be its own. braking: that mode shows.
    by_hand: its script has set nothing, since a human has set the mode that stands: this hold's, or another.
    rebooted: the autopilot rebooted and has not been armed since. No human chose the modes that it shows.
    seen: its first blocked frame, in which the operator may tap. None: not blocked yet, or it has a call.
    confirmed_at: when the autopilot first confirmed it, None before.
    interrupted: the mission that it interrupted. guided_out_of: as of `ModeMonitor` when it began: once it
    stands, that is the mode to return to.
    """

    id: int
    mode: int
    mode_before: int
    started_at: float
    state: HoldState = HoldState.REQUESTED
    tries: int = 0
    commanded_at: float = 0.0
    tried_at: float = 0.0
    failed: bool = False
    only_fault: bool = True
    resumed_at: float | None = None
    resume_taken: bool = False
    held_at: float | None = None
    may_brake_until: float = -math.inf
    braking: bool = False
    by_hand: bool = False
    rebooted: bool = False
    seen: Assessment | None = None
    confirmed_at: float | None = None
    commanded_as: int = 0
    interrupted: HeldMission = field(default_factory=HeldMission)
    guided_out_of: int | None = None

    def __post_init__(self) -> None:
        self.commanded_as = self.commanded_as or self.id

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
        self.may_brake_until, self.braking = -math.inf, False

    def may_brake(self, seconds: float, round_trip: float, now: float) -> None:
        """Note that the command to hold that leaves now lets the script brake for so long first."""
        if not self.braking:
            self.may_brake_until = now + round_trip + seconds + _BRAKE_LATER

    def begin_resume(self) -> None:
        """Return to the mode before the hold."""
        self.enter(HoldState.RESUMING)
        self.resumed_at, self.resume_taken = None, False

    def cancel_resume(self) -> None:
        """Hold again while a resume is under way: the autopilot may already have changed back."""
        self.enter(HoldState.REQUESTED)
        self.held_at, self.by_hand = None, False

    def request_again(self) -> None:
        """Request the hold again after the autopilot rebooted. From now on it needs a go to end."""
        self.enter(HoldState.REQUESTED)
        self.rebooted, self.only_fault, self.by_hand = True, False, False
        self.interrupted = self.interrupted.rebooted()
        if self.guided_out_of is not None:  # nobody guides after a reboot
            self.mode_before, self.guided_out_of = self.guided_out_of, None
        self.resumed_at = self.held_at = self.confirmed_at = None

    def note_mission(self, report: ModeReport) -> None:
        """Take in what the vehicle reports of its mission."""
        if self.confirmed_at is not None and report.mode == self.mode:
            self.interrupted = self.interrupted.standing(report)
        elif not self.standing:
            self.interrupted = self.interrupted.driving(report)

    def needs_lead(self, autopilot: Autopilot | None, now: float) -> bool:
        """Whether setpoints must be streamed for longer before the mode that holds is commanded."""
        if autopilot is None or self.mode not in autopilot.streamed:
            return False
        return now - self.started_at < autopilot.lead

    def adopt_rest_mode(self, mode: int | None, autopilot: Autopilot | None) -> None:
        """Adopt the rest mode where the autopilot changed to it because our setpoints stopped."""
        if autopilot is not None and self.mode in autopilot.streamed and mode == autopilot.rest_mode:
            self.mode = autopilot.rest_mode

    def tick(
        self, now: float, numbers: Numbers, round_trip: float = 0.0
    ) -> tuple[int | None, HoldEvent | None]:
        """Return the mode to command now, if any, and FAILED once when all tries are used up.

        round_trip: s in which a resume shows; before that it is not repeated, or it would override a human
        who sets a mode after the first one was carried out.
        """
        wanted = self.wanted_mode
        pause = numbers.mode_retry_failed if self.failed else numbers.mode_retry
        if self.state is HoldState.RESUMING:
            pause = max(pause, round_trip + _RESUME_SHOWS_LATER)
        if wanted is None or (self.tries and now - self.tried_at < pause):
            return None, None
        event = None
        if self.tries == numbers.mode_tries and not self.failed and not self.braking:
            event = HoldEvent.FAILED
            if self.state is HoldState.RESUMING:
                # The vehicle still stands: give up the resume, and wait for a new go.
                self.enter(HoldState.STANDING)
                self.resume_taken, self.held_at = False, None
                return None, event
            self.failed = True
        self.commanded_at = self.commanded_at if self.tries else now
        # In the brake a command only asks whether it is still the script's: that is no try.
        self.tries += not (self.braking and self.tries)
        self.tried_at = now
        return wanted, event

    def answered(self, answer: ModeAnswer, now: float) -> HoldEvent | None:
        """Take in the answer to a mode command, and return what that means for the hold."""
        if answer.by_hand and (self.standing or self.braking or self.guided_out_of is not None):
            return HoldEvent.TAKEN_OVER
        self.by_hand = answer.by_hand  # which mode that is, the next report shows
        if answer.brakes_out_of is not None and self.mode_before != answer.brakes_out_of:
            # The script had begun to brake for its own reason before this hold began.
            self.mode_before = answer.brakes_out_of
            self.may_brake(LONGEST_BRAKE, 0.0, now)
        if answer.accepted and answer.mode == self.mode and self.state is HoldState.REQUESTED:
            # Commands are carried out in order, so no resume is under way behind this one.
            self.held_at, self.resumed_at = now, None
        elif answer.mode == self.mode_before and self.resumed_at is not None:
            self.resume_taken = answer.accepted
            self.resumed_at = self.resumed_at if answer.accepted else None
        return None

    def mode_reported(self, report: ModeReport, now: float) -> HoldEvent | None:
        """Take in the mode that the vehicle reports, and return what that means for the hold.

        A mode that we did not command was set by a human, who always wins.
        """
        if report.mode == self.mode:
            if self.state is HoldState.REQUESTED and self._from_before_cancel(report):
                return None
            if self.by_hand:
                return HoldEvent.TAKEN_OVER
            self.confirmed_at = now if self.confirmed_at is None else self.confirmed_at
            if self.state is not HoldState.REQUESTED:
                return None
            self.enter(HoldState.STANDING)
            self.resumed_at = None
            if self.guided_out_of is not None:
                self.mode_before = self.guided_out_of
            return HoldEvent.CONFIRMED
        if self.guided_out_of is not None and self._crossed(report):
            self.mode_before = self.guided_out_of
            return None
        if self._entered_anew(report, now):
            self.enter(HoldState.REQUESTED)
            self.confirmed_at = None
            self.may_brake(LONGEST_BRAKE, 0.0, now)
        if self._shows_brake(report):
            # It came after the mode before the hold: that one, shown again, is a human's.
            self.braking, self.held_at, self.resumed_at = True, report.reported_at, None
            return HoldEvent.TAKEN_OVER if self.by_hand else None
        if report.mode != self.mode_before:
            return HoldEvent.TAKEN_OVER
        if self.state is HoldState.RESUMING:
            return HoldEvent.RESUMED
        if self.state is HoldState.REQUESTED and self._ours(report):
            return None
        if self.state is HoldState.STANDING and self.resumed_at is not None and self._ours(report):
            self.enter(HoldState.REQUESTED)  # a resume that was given up is carried out late
            return None
        self.resumed_at = None  # it is the human's mode, too: a late resume changes nothing
        return HoldEvent.TAKEN_OVER

    def resume_under_way(self, now: float, round_trip: float) -> bool:
        """Whether a resume was commanded, and the autopilot may still carry it out."""
        return self.resumed_at is not None and (self.resume_taken or now - self.resumed_at <= round_trip)

    def _crossed(self, report: ModeReport) -> bool:
        """Whether our request to give GUIDED back was carried out just before the command to hold."""
        if self.state is not HoldState.REQUESTED or report.reported_at is None:
            return False
        since = report.reported_at - self.started_at
        return report.mode == self.guided_out_of != self.mode_before and since <= _CROSSED

    def _entered_anew(self, report: ModeReport, now: float) -> bool:
        """Whether the script has left GUIDED for this hold only to enter it anew, in which it brakes."""
        if self.state is not HoldState.STANDING or self.guided_out_of is None or report.autopilot is None:
            return False
        since = math.inf if self.confirmed_at is None else now - self.confirmed_at
        return report.mode == report.autopilot.brake_mode and since <= _REPORT_LAG

    def _shows_brake(self, report: ModeReport) -> bool:
        """Whether the mode may be the script's brake. If it is a human's, the script's answer says so."""
        told = report.brake > 0.0 or self.held_at is not None
        if self.state is not HoldState.REQUESTED or not told:
            return False
        if report.reported_at is None or report.autopilot is None:
            return False
        brakes_in = report.autopilot.brake_mode if report.mode != self.mode_before else None
        return report.mode == brakes_in and report.reported_at <= self.may_brake_until

    def _from_before_cancel(self, report: ModeReport) -> bool:
        """Whether the report may have left before the command that cancels a resume was carried out."""
        if self.resumed_at is None or report.reported_at is None:
            return False
        return not self.tries or report.reported_at < self.commanded_at + report.round_trip

    def _ours(self, report: ModeReport) -> bool:
        """Whether the mode before the hold shows only because our command to hold is not carried out yet."""
        late = report.autopilot is not None and report.autopilot.reports_mode_late
        lag = _LATE_REPORT_LAG if late else _REPORT_LAG
        at = -math.inf if report.reported_at is None else report.reported_at
        if self.held_at is not None:
            return at <= self.held_at + (lag if late else 0.0)
        return self.resumed_at is None or self.resume_under_way(at, report.round_trip + lag)


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
