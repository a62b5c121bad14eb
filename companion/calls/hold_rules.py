"""Decides what is commanded for a hold, and when it may end; `machine` decides that one starts.

A human always wins. The vehicle is held only out of the autopilot's own driving modes, only when armed, and
only while the autopilot's heartbeats come. Only a hold that the companion commanded is ended.
"""

from __future__ import annotations

import math

from anytraverse.assessment import Assessment, Reason
from companion.calls.decisions import (
    Decision,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldShown,
    HoldStarted,
    ResumeCancelled,
    SetMode,
)
from companion.calls.hold import Hold, HoldEvent, HoldState, OffboardRelease
from companion.calls.mode_monitor import HeldMission, ModeAnswer, ModeMonitor, ModeReport
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import ReasonFilter
from companion.vehicle.ardupilot import LONGEST_BRAKE, ScriptHold
from companion.vehicle.state import MissionState
from companion.wire.ids import Motion

OVERRIDE_WINDOW = 1.5
"""Seconds, beside the round trip, after which our resume is not under way any more when a human took over."""
SHOWN_WITHIN = 2.5
"""Seconds: a resume waits for a report of the mode that is no older."""
RESUME_WAITS = 5.0
"""Seconds that a go waits while the link cannot resume: after a break it first looks for the script."""


class HoldController:
    """Controls the one hold.

    go_at: when the go was given that the hold waits to fulfil, None without one.
    go_counts: whether this go is in the journal, or the disk was too slow to store it. An earlier go that no
    other answer revoked will do, too.
    revoked_at: when the newest answer that was not a go was given.
    offboard_release: the release of a hold that stood on our setpoints. Nothing else is commanded meanwhile.
    """

    def __init__(self, numbers: Numbers, monitor: ModeMonitor, reason_filter: ReasonFilter) -> None:
        self._numbers = numbers
        self._monitor = monitor
        self._reason_filter = reason_filter
        self.hold: Hold | None = None
        self.go_at: float | None = None
        self.go_counts = False
        self.revoked_at = -math.inf
        self._first_go_at = -math.inf
        self.offboard_release: OffboardRelease | None = None
        self._late_resume: tuple[int, float] = 0, -math.inf
        """The mode of a resume that may still be under way after a human took over, and until when."""

    def restore(self, hold: Hold | None) -> None:
        """Take the hold from before a restart, during which the autopilot's script may brake for it."""
        self.hold = hold
        if hold is not None:
            hold.may_brake(LONGEST_BRAKE, 0.0, hold.started_at)

    def vehicle_reported(self, report: ModeReport, now: float) -> HoldEvent | None:
        """Take in a report of the autopilot, and return what it means for the hold."""
        before = self._monitor.reported(report)
        if self.hold is not None:
            self.hold.note_mission(report)
        if before is None or self.hold is None or report.mode is None or self.offboard_release is not None:
            return None
        if self._monitor.silent_since(before):
            self.hold.adopt_rest_mode(report.mode, report.autopilot)
        return self._reboot(self.hold, before, now) or (
            None if self.hold.rebooted else self._mode_reported(self.hold, report, now)
        )

    def _mode_reported(self, hold: Hold, report: ModeReport, now: float) -> HoldEvent | None:
        event = hold.mode_reported(report, now)
        window = OVERRIDE_WINDOW + report.round_trip
        if event is HoldEvent.TAKEN_OVER and hold.resume_under_way(now, window):
            self._late_resume = hold.mode_before, now + window
        return event

    def mode_answered(self, answer: ModeAnswer, now: float) -> HoldEvent | None:
        """Take in the answer to a mode command, and return what it means for the hold."""
        return None if self.hold is None else self.hold.answered(answer, now)

    def overrode(self, now: float) -> bool:
        """Whether our late resume has replaced the mode of a human who had taken over."""
        mode, until = self._late_resume
        return now <= until and self._monitor.drives_itself(now) and self._monitor.newest.mode == mode

    def _reboot(self, hold: Hold, before: ModeReport, now: float) -> HoldEvent | None:
        """Decide what the modes after a reboot of the autopilot mean.

        Until it is armed, no mode that it shows was set by a human. If it is then armed in a mode in which it
        drives by itself, it is held again; in any other mode a human drives.
        """
        report = self._monitor.newest
        if self._monitor.shows_reboot:
            known = hold.rebooted or (before.reported_at is None and not report.booting)
            hold.request_again()
            self.go_at = None
            return None if known else HoldEvent.REBOOTED
        if not hold.rebooted or report.mode is None:
            return None
        if report.mode == hold.mode:
            hold.rebooted = not report.armed
            return hold.mode_reported(report, now)
        hold.enter(HoldState.REQUESTED)
        if not report.armed:
            return None
        if report.in_driving_mode:
            hold.rebooted, hold.mode_before = False, report.mode
        elif not before.armed and not before.booting:
            return HoldEvent.TAKEN_OVER
        return None

    @property
    def script_holds(self) -> ScriptHold | None:
        """The hold by the autopilot's script in which the vehicle stands, None without one."""
        return self._monitor.script_hold if self.hold is None else None

    @property
    def streams(self) -> bool:
        """Whether zero-velocity setpoints must be sent now: from before the hold's mode until it is left."""
        autopilot = self._monitor.newest.autopilot
        held = self.hold is not None and autopilot is not None and self.hold.mode in autopilot.streamed
        return held or self.offboard_release is not None

    def in_charge(self, now: float) -> bool:
        """Whether the armed vehicle drives by itself or stands in our hold, and the autopilot is heard.

        Any other mode is a human's or a fail-safe's.
        """
        report = self._monitor.newest
        ours = self.hold is not None and report.mode == self.hold.mode
        heard = self._monitor.known(now) and not self._monitor.heartbeat_lost(now)
        return heard and report.armed and (report.drives_itself or ours)

    def start(self, number: int, reasons: frozenset[Reason], now: float) -> HoldStarted:
        """Start a hold out of the mode that the vehicle shows. An earlier go does not apply to it."""
        report = self._monitor.newest
        assert report.mode is not None
        assert report.autopilot is not None
        self.hold, self.go_at = Hold(number, report.autopilot.hold_mode, report.mode, now), None
        self.hold.guided_out_of = self._monitor.guided_out_of
        self.hold.interrupted = HeldMission().driving(report)
        self.offboard_release, self._late_resume = None, (0, -math.inf)
        return HoldStarted(self.hold, reasons)

    def end(self) -> Hold | None:
        """End the hold, and return it."""
        hold, self.hold, self.go_at = self.hold, None, None
        return hold

    def rename(self, number: int) -> list[Decision]:
        """Give the hold the id of a call that opened during it. An earlier go did not know of that call."""
        if self.hold is None:
            return []
        old, self.hold.id, self.go_at = self.hold.id, number, None
        return [HoldRenamed(old, self.hold)]

    def require_go(self, *, anew: bool) -> None:
        """Require a go to end the current hold. anew: an earlier go is revoked."""
        if self.hold is not None:
            self.hold.only_fault = False
            if anew:
                self.go_at = None

    def release(self, now: float) -> None:
        """Begin to release a hold that stands on our setpoints, since we may or can hold no longer."""
        if self.hold is not None and self.offboard_release is None:
            self.offboard_release = OffboardRelease.of(self.hold, self._monitor.newest.autopilot, now)

    def settle_release(self, now: float) -> list[Decision]:
        """Return what the release that `release` began needs now."""
        release, report = self.offboard_release, self._monitor.newest
        if release is None:
            return []
        if not report.armed or release.over(report.mode, now, self._numbers):
            self.offboard_release = None
            if self.hold is not None:
                self.hold.adopt_rest_mode(report.mode, report.autopilot)
            return []
        mode = release.tick(report.mode, now, self._numbers) if self._monitor.known(now) else None
        return [] if mode is None else [SetMode(mode)]

    def answer(self, motion: Motion, at: float) -> None:
        """Take in the motion of an answer that was received at `at`. The newest answer decides.

        Any answer but a go revokes an earlier go. A go has no effect before it is stored in the journal; it
        does not stop a resume that an earlier go began.
        """
        if motion is not Motion.GO:
            self.revoked_at = at
        if self.hold is None or motion is not Motion.GO:
            self.go_at = None
            return
        if self.go_at is None:
            self.go_counts, self._first_go_at = False, at
        self.go_at = at

    def confirm_go(self, at: float) -> None:
        """Let the go received at `at` count, unless it was revoked. OK frames from now on fulfil it."""
        if self.hold is None or self.go_at is None or self.go_counts or at < self._first_go_at:
            return
        self.go_counts = True
        # OK frames from before the go was stored do not count, unless an earlier go already resumes.
        if self.hold.state is not HoldState.RESUMING:
            self._reason_filter.restart_ok_run()

    def settle(self, reasons: frozenset[Reason], asking: bool, now: float) -> list[Decision]:
        """Advance the hold, and return the decisions. asking: a call is open, so the hold needs a go."""
        hold = self.hold
        if hold is None or self.offboard_release is not None:
            return []
        decisions: list[Decision] = []
        hold.only_fault = hold.only_fault and not asking and reasons <= {Reason.FAULT}
        if hold.seen is None and not asking and Reason.BLOCKED in reasons:
            decisions += self._show_blocked(hold, self._reason_filter.newest)
        if self.go_at is not None and self._go_expired(self.go_at, now):
            self.go_at = None
            decisions.append(GoLapsed(hold.id))
        ready = not reasons and self._ready(hold, now)
        if hold.state is HoldState.RESUMING and not ready:
            hold.cancel_resume()
            decisions.append(ResumeCancelled(hold.id))
        elif hold.state is not HoldState.RESUMING and ready and self.mission_ended:
            self.go_at, hold.only_fault = None, False
            decisions.append(HoldMoved(hold, HoldEvent.MISSION_OVER))
        elif hold.state is not HoldState.RESUMING and ready and not self._awaits_mission:
            hold.begin_resume()
        return decisions + self._command(hold, now)

    def _show_blocked(self, hold: Hold, newest: Assessment | None) -> list[Decision]:
        if newest is None or Reason.BLOCKED not in newest.reasons:
            return []
        hold.seen = newest
        return [HoldShown(hold, newest)]

    def _command(self, hold: Hold, now: float) -> list[Decision]:
        autopilot = self._monitor.newest.autopilot
        if not self._monitor.newest.armed or hold.rebooted or hold.needs_lead(autopilot, now):
            return []
        decisions: list[Decision] = []
        resuming = hold.state is HoldState.RESUMING
        mode, event = hold.tick(now, self._numbers, self._monitor.newest.round_trip)
        if event is not None:
            decisions.append(HoldMoved(hold, event, resuming))
            if resuming:
                self.go_at, hold.only_fault = None, False
        if mode is not None and self._may_command(hold, mode, now):
            expected = hold.mode if hold.state is HoldState.RESUMING else hold.mode_before
            hold.resumed_at = now if hold.state is HoldState.RESUMING else hold.resumed_at
            if hold.state is HoldState.REQUESTED and self._brakes(hold):
                hold.may_brake(self._monitor.newest.brake, self._monitor.newest.round_trip, now)
            decisions.append(SetMode(mode, expected, hold.commanded_as))
        return decisions

    def _may_command(self, hold: Hold, mode: int, now: float) -> bool:
        """Whether the vehicle's mode allows the command.

        A resume is commanded only out of our hold; a hold also out of the autopilot's driving modes.
        """
        if hold.braking and not self._monitor.newest.compares:
            return False  # what goes past the script replaces the mode of a human who has taken over
        if self._monitor.newest.mode == hold.mode:
            return self._monitor.known(now) and self._monitor.newest.autopilot is not None
        return mode == hold.mode and self._monitor.known(now) and self._monitor.newest.in_driving_mode

    def _brakes(self, hold: Hold) -> bool:
        """Whether the command to hold lets the script brake first."""
        report = self._monitor.newest
        drives = report.autopilot is not None and hold.mode_before in report.autopilot.mission_modes
        return drives and report.compares and report.brake > 0.0

    @property
    def interrupted_mission(self) -> HeldMission | None:
        """The mission to which a resume returns, None where the mode before the hold drives none."""
        hold, autopilot = self.hold, self._monitor.newest.autopilot
        drove = hold is not None and autopilot is not None and hold.mode_before in autopilot.mission_modes
        return hold.interrupted if hold is not None and drove else None

    @property
    def mission_ended(self) -> bool:
        """Whether a resume would begin a mission anew that has ended."""
        mission = self.interrupted_mission
        return mission is not None and mission.ended

    @property
    def _awaits_mission(self) -> bool:
        """Whether the mission's state must first be reported out of the hold: it may have been completed."""
        mission = self._monitor.newest.mission
        if self.interrupted_mission is None or mission is None or mission.fresh:
            return False
        return mission.state is not MissionState.UNKNOWN

    def _ready(self, hold: Hold, now: float) -> bool:
        report = self._monitor.newest
        if not report.armed or not self._monitor.known(now) or self._monitor.heartbeat_lost(now):
            return False
        if not report.takes_resume:
            return False
        if self._reason_filter.ok_run < self._numbers.ok_frames:
            return False
        if report.mode not in (hold.mode, hold.mode_before):
            return False
        given = self.go_at is not None and self.go_counts
        if not given and not (self._numbers.fault_ends_hold and hold.only_fault):
            return False
        return self._still_held(self._first_go_at if given else self._reason_filter.not_ok_at, now)

    def _still_held(self, since: float, now: float) -> bool:
        """Whether a report that left after `since` shows the mode, so that no human changed it unseen.

        A script that compares before it sets the mode knows better.
        """
        report = self._monitor.newest
        if report.compares or report.reported_at is None:
            return report.compares
        return report.reported_at >= since + report.round_trip and now - report.reported_at <= SHOWN_WITHIN

    def _go_expired(self, go_at: float, now: float) -> bool:
        """Whether a go has expired.

        It waits `go_lasts` for a clear view and `RESUME_WAITS` for a link that sends no resume. It does not
        wait for arming or for a lost autopilot.
        """
        too_old = self._reason_filter.not_ok_at - go_at > self._numbers.go_lasts
        report = self._monitor.newest
        too_old = too_old or (not report.takes_resume and now - go_at > RESUME_WAITS)
        return too_old or not report.armed or not self._monitor.known(now)
