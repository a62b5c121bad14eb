"""Passes on to the state machine what the autopilot and the vision process report."""

from __future__ import annotations

from collections.abc import Sequence

from anytraverse.memory import Memory
from companion.calls.decisions import Decision
from companion.calls.faults import Fault
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.daemon.answers.handler import AnswerHandler
from companion.daemon.call_frames import CallFrames
from companion.daemon.executor import DecisionExecutor
from companion.daemon.persistence import Persistence
from companion.daemon.requests import Requests
from companion.link.link import Link
from companion.vehicle import known_autopilot
from companion.vehicle.course import CourseJudge
from companion.vehicle.state import Odometer, Vehicle, VehiclePosition, is_moving, stands
from companion.vision.client import VisionResult
from companion.vision.messages import Done, Drawn, FrameJudged


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
            modes.brake,
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


class VisionResults:
    """Handles the results one by one. A new memory is queued for the disk before its frame can count."""

    def __init__(
        self,
        calls: OperatorCalls,
        persistence: Persistence,
        frames: CallFrames,
        executor: DecisionExecutor,
        requests: Requests,
        answer_handler: AnswerHandler,
    ) -> None:
        self._calls = calls
        self._persistence = persistence
        self._frames = frames
        self._executor = executor
        self._requests = requests
        self._answer_handler = answer_handler

    def received(self, result: VisionResult, now: float) -> None:
        """Handle a result."""
        match result.report:
            case FrameJudged() as judged:
                self._judged(judged, result.memory, now)
            case Done() as done:
                self._applied(done, result, now)
            case Drawn() as drawn:
                self._frames.drawn(drawn)

    def _judged(self, judged: FrameJudged, memory: Memory, now: float) -> None:
        seen = judged.assessment
        self._persistence.save_memory(memory)
        self._frames.forget_lost()
        # A frame judged by words that a power loss may still undo can hold the vehicle, not release it.
        memory_stored = self._persistence.memory_stored(now, memory)
        decisions = self._calls.assessed(seen, now, memory_stored=memory_stored)
        self._executor.carry_out(decisions, now, at_once=True)
        if seen.adopted is not None:
            self._answer_handler.place_matched(now)
        self._frames.replace_lost(seen)

    def _applied(self, done: Done, result: VisionResult, now: float) -> None:
        self._persistence.save_memory(result.memory)
        if self._frames.is_call_frame(result.token):
            self._frames.call_frame_judged(done)
            return
        self._requests.applied(done, result, now)
        if done.outcome is not None:
            self._frames.answered(now)
