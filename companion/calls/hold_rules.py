"""The one hold: when it may start, what may be commanded for it, and when it may end.

Never over a human: only out of the autopilot's own driving modes, only when armed, and only while the
autopilot is heard. Only our own hold is undone.
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
class Vehicle:
    """The newest that the autopilot said. mode None: nothing yet. travelled: metres, None where not known.

    heard_at: when it last told its mode. autopilot: its table; None: of a kind that is never commanded.
    """

    mode: int | None = None
    armed: bool = False
    travelled: float | None = None
    heard_at: float | None = None
    autopilot: Autopilot | None = None

    @property
    def drives_itself(self) -> bool:
        """Whether the autopilot drives, so that a hold takes the vehicle from nobody."""
        return self.autopilot is not None and self.armed and self.mode in self.autopilot.holdable


class HoldController:
    """At most one hold. go_at: when the go was given that the hold waits to fulfil. go_counts: it is kept, or
    one before it that nothing took back. taken_back_at: when the newest answer that was no go was given.

    handover: the end of a hold that stood on our setpoints; nothing else is commanded meanwhile.
    script_told: of the hold of the autopilot's script, until the vehicle shows that it is over.
    """

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.hold: Hold | None = None
        self.vehicle = Vehicle()
        self.go_at: float | None = None
        self.go_counts = False
        self.taken_back_at = -math.inf
        self._first_go_at = -math.inf
        self.handover: OffboardRelease | None = None
        self.script_told: ScriptHold | None = None
        self._forgotten_at = self._silent_at = -math.inf
        self._beat_at: float | None = None

    def hear(self, vehicle: Vehicle, now: float) -> HoldEvent | None:
        """The autopilot showed its mode, or, with the old `heard_at`, only where it is."""
        self._beat(vehicle.heard_at)
        if vehicle.heard_at is not None and vehicle.heard_at <= self._forgotten_at:
            vehicle = replace(vehicle, heard_at=None)
        before, self.vehicle = self.vehicle, vehicle
        news = (vehicle.heard_at, vehicle.mode, vehicle.armed) != (before.heard_at, before.mode, before.armed)
        if news and not self._at_rest:
            self.script_told = None
        if not news or self.hold is None or vehicle.mode is None or self.handover is not None:
            return None
        unseen = self._unseen(before)
        if unseen:
            self.hold.found_at_rest(vehicle.mode, vehicle.autopilot)
        return self._reboot(self.hold, before, now, unseen=unseen) or (
            None if self.hold.rebooted else self.hold.vehicle(vehicle.mode, now, self.numbers)
        )

    def _unseen(self, before: Vehicle) -> bool:
        """Whether it was not heard for a while before it told its mode."""
        heard_at = self.vehicle.heard_at
        if heard_at is None or before.heard_at is None:
            return True
        return heard_at - before.heard_at > self.numbers.heartbeat_lost

    def _reboot(self, hold: Hold, before: Vehicle, now: float, *, unseen: bool) -> HoldEvent | None:
        """What a boot of the autopilot means: no mode that it shows, until it is armed, is a human's.

        Armed then in a mode that drives by itself it is held again, in another one it is a human who drives.
        """
        vehicle, autopilot = self.vehicle, self.vehicle.autopilot
        boots = autopilot.booting if autopilot is not None else frozenset[int]()
        booting = vehicle.mode in boots
        lost = unseen and not vehicle.armed and (before.armed or vehicle.mode != hold.mode)
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
        elif not before.armed and before.mode not in boots:
            return HoldEvent.TAKEN_OVER
        return None

    def forget(self, now: float, slept: float = 0.0) -> None:
        """What was told until now is not known to be the mode any more. slept: s in which we heard nobody."""
        self._forgotten_at = now
        if self._beat_at is not None:
            self._beat_at += slept
        self.vehicle = replace(self.vehicle, heard_at=None)

    def heard(self, now: float) -> bool:
        """Whether the mode is known: it was told within `vehicle_silence`."""
        heard_at = self.vehicle.heard_at
        return heard_at is not None and now - heard_at <= self.numbers.vehicle_silence

    def silent(self, now: float) -> bool:
        """Whether the heartbeat of an autopilot that was heard is lost, or was until shortly ago."""
        if self._beat_at is None:
            return False
        lost = now - self._beat_at > self.numbers.heartbeat_lost
        return lost or now - self._silent_at < self.numbers.heartbeat_back

    def _beat(self, heard_at: float | None) -> None:
        if heard_at is None or (self._beat_at is not None and heard_at <= self._beat_at):
            return
        if self._beat_at is not None and heard_at - self._beat_at > self.numbers.heartbeat_lost:
            self._silent_at = heard_at
        self._beat_at = heard_at

    def drives_itself(self, now: float) -> bool:
        """Whether the autopilot drives by itself, as far as is known now."""
        return self.heard(now) and self.vehicle.drives_itself

    @property
    def script_holds(self) -> ScriptHold | None:
        """The hold of the autopilot's script that the vehicle stands in; None without one."""
        return self.script_told if self.hold is None and self._at_rest else None

    @property
    def _at_rest(self) -> bool:
        vehicle = self.vehicle
        return vehicle.armed and vehicle.autopilot is not None and vehicle.mode == vehicle.autopilot.rest_mode

    @property
    def streams(self) -> bool:
        """Whether zero velocity must reach the autopilot now: from before the hold's mode until the next."""
        autopilot = self.vehicle.autopilot
        held = self.hold is not None and autopilot is not None and self.hold.mode in autopilot.streamed
        return held or self.handover is not None

    def start(self, number: int, reasons: frozenset[Reason], now: float) -> HoldStarted:
        """Hold the vehicle, out of the mode that it shows; a go given before is not for this."""
        vehicle = self.vehicle
        assert vehicle.mode is not None
        assert vehicle.autopilot is not None
        self.hold, self.go_at = Hold(number, vehicle.autopilot.hold_mode, vehicle.mode, now), None
        self.handover = None
        return HoldStarted(self.hold, reasons)

    def end(self) -> Hold | None:
        """The hold is over, whatever ended it."""
        hold, self.hold, self.go_at = self.hold, None, None
        return hold

    def leave(self, now: float) -> None:
        """We may or can hold no more: a hold that stands on our setpoints is handed to the autopilot."""
        if self.hold is not None and self.handover is None:
            self.handover = OffboardRelease.of(self.hold, self.vehicle.autopilot, now)

    def hand_over(self, now: float) -> list[Decision]:
        """What is to be done now for `leave`."""
        if self.handover is None:
            return []
        if not self.vehicle.armed or self.handover.over(self.vehicle.mode, now, self.numbers):
            self.handover = None
            if self.hold is not None:
                self.hold.found_at_rest(self.vehicle.mode, self.vehicle.autopilot)
            return []
        mode = self.handover.tick(self.vehicle.mode, now, self.numbers) if self.heard(now) else None
        return [] if mode is None else [SetMode(mode)]

    def answer(self, motion: Motion, at: float) -> None:
        """The newest answer, heard at `at`, decides: whatever is not a go takes an earlier one back.

        A go moves nothing before it is kept, nor does it stop what an earlier one moves.
        """
        if motion is not Motion.GO:
            self.taken_back_at = at
        if self.hold is None or motion is not Motion.GO:
            self.go_at = None
            return
        if self.go_at is None:
            self.go_counts, self._first_go_at = False, at
        self.go_at = at

    def go_kept(self, at: float, reason_filter: ReasonFilter) -> None:
        """The go heard at `at` counts unless it was taken back; OK frames from now on fulfil it."""
        if self.hold is None or self.go_at is None or self.go_counts or at < self._first_go_at:
            return
        self.go_counts = True
        if self.hold.stage is not HoldStage.RESUMING:
            reason_filter.ok_run = 0

    def settle(
        self, reasons: frozenset[Reason], reason_filter: ReasonFilter, asking: bool, now: float
    ) -> list[Decision]:
        """What is to be done now. asking: a call is open, so that the hold is not a fault's alone."""
        hold = self.hold
        if hold is None or self.handover is not None:
            return []
        decisions: list[Decision] = []
        hold.only_fault = hold.only_fault and not asking and reasons <= {Reason.FAULT}
        if hold.seen is None and not asking and Reason.BLOCKED in reasons:
            decisions += self._show(hold, reason_filter.newest)
        if self.go_at is not None and self._lapsed(self.go_at, reason_filter, now):
            self.go_at = None
            decisions.append(GoLapsed(hold.id))
        ready = not reasons and self._ready(hold, reason_filter, now)
        if hold.stage is HoldStage.RESUMING and not ready:
            hold.call_back(now)
        elif hold.stage is not HoldStage.RESUMING and ready:
            hold.turn(HoldStage.RESUMING)
        return decisions + self._command(hold, now)

    def _show(self, hold: Hold, newest: Assessment | None) -> list[Decision]:
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
        """The way back only out of our hold; a hold out of that or a driving mode."""
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

    def _lapsed(self, go_at: float, reason_filter: ReasonFilter, now: float) -> bool:
        """A go is for now: it does not wait long for a clear view, nor for arming or a lost autopilot."""
        too_old = reason_filter.bad_at - go_at > self.numbers.go_lasts
        return too_old or not self.vehicle.armed or not self.heard(now)
