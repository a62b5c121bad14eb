"""Passes on to the state machine what the autopilot reports, and where the vehicle drives."""

from __future__ import annotations

from collections.abc import Sequence

from companion.calls.decisions import Decision
from companion.calls.faults import Fault
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.link.link import Link
from companion.vehicle import known_autopilot
from companion.vehicle.course import CourseJudge
from companion.vehicle.position import Odometer
from companion.vehicle.state import Vehicle, VehiclePosition, is_moving, stands


class VehicleReports:
    """Returns what the state machine decides on each report."""

    def __init__(
        self, link: Link, calls: OperatorCalls, position: VehiclePosition, course: CourseJudge
    ) -> None:
        """course: judges whether the vehicle drives where the camera looks."""
        self._link = link
        self._calls = calls
        self._course = course
        self.position = position
        self._odometer = Odometer()

    def moves(self, now: float) -> bool:
        """Whether the vehicle moves, as far as is known."""
        drives_itself = self._calls.monitor.newest.drives_itself
        return is_moving(self._link.vehicle, now, drives_itself=drives_itself)

    def received(self, vehicle: Vehicle, now: float) -> Sequence[Decision]:
        """Take the newest state of the vehicle."""
        travelled = self._odometer.travelled(vehicle.position)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type, self._calls.numbers.px4_hold)
        modes = self._link.modes
        report = ModeReport(
            vehicle.custom_mode,
            vehicle.armed,
            travelled,
            vehicle.heard_at,
            autopilot,
            modes.round_trip,
            modes.compares,
            modes.takes_resume,
            vehicle.reboots,
            vehicle.mission,
            stands(vehicle, now),
        )
        return self._calls.vehicle_reported(report, now)

    def check_course(self, now: float) -> Sequence[Decision]:
        """Report whether the vehicle drives where its camera does not look.

        Standing still ends no such fault in our hold: only a go does, or a human's mode.
        """
        calls, before = self._calls, self._course.told
        # After a mission that is complete it may roll back a little as it stops.
        drives = calls.monitor.drives_itself(now) and not calls.monitor.newest.mission_ended
        held = calls.hold is not None and calls.go_at is None
        told = self._course.judge(self._link.vehicle, now, drives=drives, held=held)
        decisions = calls.fault_reported(Fault.COURSE, told, now) if told != before else []
        if told:
            calls.holding.require_go(anew=not before)
        return decisions
