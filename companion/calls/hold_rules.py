"""Decides when the hold may start, what may be commanded for it, and when it may end.

A human always wins. The vehicle is held only out of the autopilot's own driving modes, only when armed, and
only while the autopilot's heartbeats come. Only a hold that the companion commanded is ended.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from anytraverse.assessment import Assessment, Reason
from companion.calls.decisions import Decision, GoLapsed, HoldMoved, HoldShown, HoldStarted, SetMode
from companion.calls.hold import Hold, HoldEvent, HoldStage, OffboardRelease
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import ReasonFilter
from companion.vehicle import Autopilot
from companion.vehicle.ardupilot import ScriptHold
from companion.wire.ids import Motion


@dataclass
class VehicleMode:
    """The state machine's view of the vehicle.

    mode: custom_mode, None before the first heartbeat. travelled: metres driven, None where not known.
    heard_at: when the mode was last reported; None: what was reported counts no more.
    autopilot: its table, None for a kind that is never commanded.
    """

    mode: int | None = None
    armed: bool = False
    travelled: float | None = None
    heard_at: float | None = None
    autopilot: Autopilot | None = None

    @property
    def drives_itself(self) -> bool:
        """Whether the autopilot drives, so that a hold overrides no human."""
        return self.autopilot is not None and self.armed and self.mode in self.autopilot.holdable


class HoldController:
    """Controls the one hold.

    go_at: when the go was given that the hold waits to fulfil, None without one.
    go_counts: this go, or an earlier one that no other answer revoked, is in the journal, or the disk did not
    take it in time.
    taken_back_at: when the newest answer that was not a go was given.
    handover: the release of a hold that stood on our setpoints. Nothing else is commanded meanwhile.
    script_hold_report: the last report of a hold by the autopilot's script, until the vehicle shows that it
    is over.
    """

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.hold: Hold | None = None
        self.vehicle = VehicleMode()
        self.go_at: float | None = None
        self.go_counts = False
        self.taken_back_at = -math.inf
        self._first_go_at = -math.inf
        self.handover: OffboardRelease | None = None
        self.script_hold_report: ScriptHold | None = None
        self._unknown_until = self._back_at = -math.inf
        self._heartbeat_at: float | None = None

    def hear(self, vehicle: VehicleMode, now: float) -> HoldEvent | None:
        """Take in a report of the autopilot, and return what it means for the hold.

        One with the `heard_at` of the report before has a new position, and no new mode.
        """
        self._take_heartbeat(vehicle.heard_at)
        # Sent before the companion hung, and read only after it: the mode may have changed since.
        if vehicle.heard_at is not None and vehicle.heard_at <= self._unknown_until:
            vehicle = replace(vehicle, heard_at=None)
        before, self.vehicle = self.vehicle, vehicle
        new = (vehicle.heard_at, vehicle.mode, vehicle.armed) != (before.heard_at, before.mode, before.armed)
        if new and not self._at_rest:
            self.script_hold_report = None
        if not new or self.hold is None or vehicle.mode is None or self.handover is not None:
            return None
        silent_before = self._unseen(before)
        if silent_before:
            self.hold.adopt_rest_mode(vehicle.mode, vehicle.autopilot)
        return self._reboot(self.hold, before, now, silent_before=silent_before) or (
            None if self.hold.rebooted else self.hold.vehicle(vehicle.mode, now, self.numbers)
        )

    def _unseen(self, before: VehicleMode) -> bool:
        """Whether the report came after a silence, in which the autopilot may have rebooted."""
        heard_at = self.vehicle.heard_at
        if heard_at is None or before.heard_at is None:
            return True
        return heard_at - before.heard_at > self.numbers.heartbeat_lost

    def _reboot(
        self, hold: Hold, before: VehicleMode, now: float, *, silent_before: bool
    ) -> HoldEvent | None:
        """Detect a reboot of the autopilot, and decide what the modes after it mean.

        Until it is armed, no mode that it shows was set by a human. If it is then armed in a mode in which it
        drives by itself, it is held again; in any other mode a human drives.
        """
        # A short reboot shows only as a silence after which the vehicle is not armed any more.
        vehicle, autopilot = self.vehicle, self.vehicle.autopilot
        boot_modes = autopilot.booting if autopilot is not None else frozenset[int]()
        booting = vehicle.mode in boot_modes
        lost = silent_before and not vehicle.armed and (before.armed or vehicle.mode != hold.mode)
        if booting or lost:
            known = hold.rebooted or (before.heard_at is None and not booting)
            hold.begin_anew()
            self.go_at = None
            return None if known else HoldEvent.REBOOTED
        if not hold.rebooted or vehicle.mode is None:
            return None
        if vehicle.mode == hold.mode:
            hold.rebooted = not vehicle.armed
            return hold.vehicle(vehicle.mode, now, self.numbers)
        hold.turn(HoldStage.REQUESTED)
        if not vehicle.armed:
            return None
        if autopilot is not None and vehicle.mode in autopilot.holdable:
            hold.rebooted, hold.mode_before = False, vehicle.mode
        elif not before.armed and before.mode not in boot_modes:
            return HoldEvent.TAKEN_OVER
        return None

    def forget(self, now: float, slept: float = 0.0) -> None:
        """Treat the mode as unknown until the next report. slept: seconds in which the companion hung.

        The autopilot was not silent in that time, so it does not count as lost heartbeats.
        """
        self._unknown_until = now
        if self._heartbeat_at is not None:
            self._heartbeat_at += slept
        self.vehicle = replace(self.vehicle, heard_at=None)

    def heard(self, now: float) -> bool:
        """Whether the mode is known: it was reported within `vehicle_silence`."""
        heard_at = self.vehicle.heard_at
        return heard_at is not None and now - heard_at <= self.numbers.vehicle_silence

    def silent(self, now: float) -> bool:
        """Whether the autopilot's heartbeats have stopped, or came back less than `heartbeat_back` ago.

        False before the first heartbeat.
        """
        if self._heartbeat_at is None:
            return False
        lost = now - self._heartbeat_at > self.numbers.heartbeat_lost
        return lost or now - self._back_at < self.numbers.heartbeat_back

    def _take_heartbeat(self, heard_at: float | None) -> None:
        if heard_at is None or (self._heartbeat_at is not None and heard_at <= self._heartbeat_at):
            return
        if self._heartbeat_at is not None and heard_at - self._heartbeat_at > self.numbers.heartbeat_lost:
            self._back_at = heard_at  # heartbeats are back: `silent` waits until they last
        self._heartbeat_at = heard_at

    def drives_itself(self, now: float) -> bool:
        """Whether the mode is known, and is one in which the autopilot drives by itself."""
        return self.heard(now) and self.vehicle.drives_itself

    @property
    def script_holds(self) -> ScriptHold | None:
        """The hold by the autopilot's script in which the vehicle stands, None without one."""
        return self.script_hold_report if self.hold is None and self._at_rest else None

    @property
    def _at_rest(self) -> bool:
        vehicle = self.vehicle
        return vehicle.armed and vehicle.autopilot is not None and vehicle.mode == vehicle.autopilot.rest_mode

    @property
    def streams(self) -> bool:
        """Whether zero-velocity setpoints must be sent now: from before the hold's mode until it is left."""
        autopilot = self.vehicle.autopilot
        held = self.hold is not None and autopilot is not None and self.hold.mode in autopilot.streamed
        return held or self.handover is not None

    def start(self, number: int, reasons: frozenset[Reason], now: float) -> HoldStarted:
        """Start a hold out of the mode that the vehicle shows. An earlier go does not apply to it."""
        vehicle = self.vehicle
        assert vehicle.mode is not None
        assert vehicle.autopilot is not None
        self.hold, self.go_at = Hold(number, vehicle.autopilot.hold_mode, vehicle.mode, now), None
        self.handover = None
        return HoldStarted(self.hold, reasons)

    def end(self) -> Hold | None:
        """End the hold, and return it."""
        hold, self.hold, self.go_at = self.hold, None, None
        return hold

    def leave(self, now: float) -> None:
        """Begin to release a hold that stands on our setpoints, since we may or can hold no longer."""
        if self.hold is not None and self.handover is None:
            self.handover = OffboardRelease.of(self.hold, self.vehicle.autopilot, now)

    def hand_over(self, now: float) -> list[Decision]:
        """Return what the release that `leave` began needs now."""
        if self.handover is None:
            return []
        if not self.vehicle.armed or self.handover.over(self.vehicle.mode, now, self.numbers):
            self.handover = None
            if self.hold is not None:
                self.hold.adopt_rest_mode(self.vehicle.mode, self.vehicle.autopilot)
            return []
        mode = self.handover.tick(self.vehicle.mode, now, self.numbers) if self.heard(now) else None
        return [] if mode is None else [SetMode(mode)]

    def answer(self, motion: Motion, at: float) -> None:
        """Take in the motion of an answer that was received at `at`. The newest answer decides.

        Any answer but a go revokes an earlier go. A go has no effect before it is stored in the journal; it
        does not stop a resume that an earlier go began.
        """
        if motion is not Motion.GO:
            self.taken_back_at = at
        if self.hold is None or motion is not Motion.GO:
            self.go_at = None
            return
        if self.go_at is None:
            self.go_counts, self._first_go_at = False, at
        self.go_at = at

    def confirm_go(self, at: float, reason_filter: ReasonFilter) -> None:
        """Let the go received at `at` count, unless it was revoked. OK frames from now on fulfil it."""
        if self.hold is None or self.go_at is None or self.go_counts or at < self._first_go_at:
            return
        self.go_counts = True
        # OK frames from before the go was stored do not count, unless an earlier go already resumes.
        if self.hold.stage is not HoldStage.RESUMING:
            reason_filter.ok_run = 0

    def settle(
        self, reasons: frozenset[Reason], reason_filter: ReasonFilter, asking: bool, now: float
    ) -> list[Decision]:
        """Advance the hold, and return the decisions. asking: a call is open, so the hold needs a go."""
        hold = self.hold
        if hold is None or self.handover is not None:
            return []
        decisions: list[Decision] = []
        hold.only_fault = hold.only_fault and not asking and reasons <= {Reason.FAULT}
        if hold.seen is None and not asking and Reason.BLOCKED in reasons:
            decisions += self._show_blocked(hold, reason_filter.newest)
        if self.go_at is not None and self._go_expired(self.go_at, reason_filter, now):
            self.go_at = None
            decisions.append(GoLapsed(hold.id))
        ready = not reasons and self._ready(hold, reason_filter, now)
        if hold.stage is HoldStage.RESUMING and not ready:
            hold.cancel_resume(now)
        elif hold.stage is not HoldStage.RESUMING and ready:
            hold.turn(HoldStage.RESUMING)
        return decisions + self._command(hold, now)

    def _show_blocked(self, hold: Hold, newest: Assessment | None) -> list[Decision]:
        if newest is None or Reason.BLOCKED not in newest.reasons:
            return []
        hold.seen = newest
        return [HoldShown(hold, newest)]

    def _command(self, hold: Hold, now: float) -> list[Decision]:
        autopilot = self.vehicle.autopilot
        if not self.vehicle.armed or hold.rebooted or hold.needs_lead(autopilot, now):
            return []
        decisions: list[Decision] = []
        resuming = hold.stage is HoldStage.RESUMING
        mode, event = hold.tick(now, self.numbers)
        if event is not None:
            decisions.append(HoldMoved(hold, event, resuming))
            if resuming:
                self.go_at, hold.only_fault = None, False
        if mode is not None and self._may_command(hold, mode, now):
            decisions.append(SetMode(mode))
        return decisions

    def _may_command(self, hold: Hold, mode: int, now: float) -> bool:
        """Whether the vehicle's mode allows the command.

        A resume is commanded only out of our hold; a hold also out of the autopilot's driving modes.
        """
        if self.vehicle.mode == hold.mode:
            return self.heard(now) and self.vehicle.autopilot is not None
        return mode == hold.mode and self.drives_itself(now)

    def _ready(self, hold: Hold, reason_filter: ReasonFilter, now: float) -> bool:
        if not self.vehicle.armed or not self.heard(now) or self.silent(now):
            return False
        if reason_filter.ok_run < self.numbers.ok_frames:
            return False
        if self.vehicle.mode not in (hold.mode, hold.mode_before):
            return False
        given = self.go_at is not None and self.go_counts
        return given or (self.numbers.fault_ends_hold and hold.only_fault)

    def _go_expired(self, go_at: float, reason_filter: ReasonFilter, now: float) -> bool:
        """Whether a go has expired.

        It waits `go_lasts` for a clear view, and does not wait for arming or for a lost autopilot.
        """
        too_old = reason_filter.bad_at - go_at > self.numbers.go_lasts
        return too_old or not self.vehicle.armed or not self.heard(now)
