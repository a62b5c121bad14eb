"""Runs the daemon's main loop: receive, decide, store, send; 50 times a second and whenever data arrives."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from anytraverse.assessment import Assessment
from anytraverse.memory import Adoption, Memory
from companion.calls.active_alert import ActiveAlert
from companion.calls.faults import Fault
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeAnswer, ModeReport
from companion.calls.summary import summary
from companion.config.video import video_size
from companion.daemon.answers.handler import AnswerHandler, Handled, Reply
from companion.daemon.executor import DecisionExecutor
from companion.daemon.health import HealthMonitor, StallDetector, WeakWords
from companion.daemon.live_picture import LivePicture, VideoPictures
from companion.daemon.persistence import Persistence
from companion.daemon.pointing import Pointing
from companion.daemon.policy.shadow_reporter import ShadowReporter
from companion.daemon.recording import Recording
from companion.daemon.records import Records
from companion.daemon.settings.service import SettingsService
from companion.daemon.startup import wait
from companion.daemon.status import Status
from companion.daemon.trial_call import TrialCall
from companion.link.inbound import (
    InboundEvent,
    ParameterRequest,
    PolicyRequest,
    RcChannels,
    ResetRequest,
    VehicleUpdate,
)
from companion.link.link import Link
from companion.system.computer import Computer
from companion.system.error_guard import ErrorGuard
from companion.tasks import Liveness, tasks
from companion.vehicle import known_autopilot
from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.course import CourseJudge
from companion.vehicle.position import Odometer
from companion.vehicle.state import Vehicle, VehiclePosition, is_moving, stands
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Done, Drawn, Encoded, FrameJudged, Model
from companion.wire import notices, texts
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, IncidentRequest, PackIncident, Via
from companion.wire.ids import ERROR, INFO, NOTICE, WARNING, Motion, Policy, State, words_hash
from companion.wire.ids import Result as AckResult

log = logging.getLogger(__name__)

TICK = 0.02
_SHORTEST_TURN = 0.005
"""Seconds between two turns, at least: a flood of datagrams must not cause a turn for each of them."""
_LEAVE_WITHIN = 4.0


class Daemon:
    """Connects the parts of the supervisor, which do not know each other.

    `turn` is one round of the main loop and waits for at most `TICK` seconds. An exception while an event or
    a result is handled, or a decision carried out, is logged and reported. One in the state machine ends the
    daemon, whichever input led to it: half of a change may have happened, so what it decides is not known to
    be right. A restart begins with a state that is: the journal's. Before that `death` holds the vehicle.
    """

    def __init__(
        self,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        persistence: Persistence,
        records: Records,
        answer_handler: AnswerHandler,
        settings: SettingsService,
        position: VehiclePosition,
        model: Model,
        *,
        view: int,
        recording: Recording,
        course: CourseJudge,
        video_rate: float = 5.0,
    ) -> None:
        """model: names the perceiver. view: the camera's horizontal field of view, degrees, 0: unknown.

        course: judges whether the vehicle drives where that camera looks.
        video_rate: pictures per second of the video.
        """
        now = time.monotonic()
        self._link = link
        self._vision = vision
        self.calls = calls
        self.persistence = persistence
        self.records = records
        self.answer_handler = answer_handler
        self.settings = settings
        self.position = position
        self.recording = recording
        self.live_picture = LivePicture(vision)
        self.pointing = Pointing(calls, link)
        self.video_pictures = VideoPictures(vision, self.pointing, self.told, video_rate)
        self.pack_incident: Callable[[int, float], tuple[AckResult, str]] = _packs_nothing
        """Has an incident packed: see `IncidentPacker.ask`."""
        self.cancel_incident: Callable[[int, float], tuple[AckResult, str]] = _packs_nothing
        """Has it packed no more: see `IncidentPacker.cancel`."""
        self._weak_words = WeakWords()
        self._view = view
        self._course = course
        self._active_alert = ActiveAlert(calls)
        self._odometer = Odometer()
        self._error_guard = ErrorGuard(lambda now: link.send_text(notices.unexpected_error(), ERROR, now))
        self._health = HealthMonitor(Liveness(tasks(calls.numbers), now), link, vision, calls, persistence)
        self._shadow = ShadowReporter(settings.statistics, calls, link, records.draw, position.clock.stamp)
        self._executor = DecisionExecutor(
            link,
            vision,
            calls,
            records,
            self._active_alert,
            self._error_guard,
            position,
            self._shadow,
            recording,
            self._health.fault_name,
        )
        self.test_call = TrialCall(records.folder, calls, link, vision, position)
        self._status = Status(link, vision, calls, settings, self.test_call, records, position, model)
        self._stall_detector = StallDetector(link, calls, now)
        self._turned_at = now
        self._reported_state = State.STARTING

    def turn(self) -> None:
        """Handle everything that was received, decide, carry it out, queue it for the disk, and send.

        Never waits for a disk.
        """
        self._wait()
        now = time.monotonic()
        # Checked twice in a turn: before anything is received, and before anything is sent, because the
        # process may be stopped at any point between.
        self._stall_detector.check(now)
        self._receive(now)
        # A hold that the events led to is sent before anything else, which may take its time.
        self._executor.send_hold_now(now)
        self._vision.rate.tick(now, self.computer.newest)
        self._vision.situation(
            self.position.place(),
            now,
            moving=is_moving(self._link.vehicle, now, drives_itself=self.calls.monitor.newest.drives_itself),
        )
        for result in self._vision.poll(now):
            with self._error_guard.survived(type(result).__name__, now):
                self._handle_result(result, now)
        for callback, stored in self.persistence.due(now):
            with self._error_guard.survived("acknowledgement", now):
                callback(stored, now)
        self._check_course(now)
        self._health.check(now)
        self._executor.carry_out(self.settings.policy.tick(now), now, at_once=True)
        self._shadow.tick(now)
        self._executor.carry_out(self.calls.tick(now), now, at_once=True)
        self.test_call.tick(now)
        self.pointing.tick(now)
        self.video_pictures.tick(self.calls.state(now), now)
        self._link.stand_still(on=self.calls.holding.streams)
        self._link.dead_man.on = self.calls.policy is Policy.HOLD and self.calls.holding.in_charge(now)
        self._report(now)
        self.recording.tick(self._reported_state, now)
        self._stall_detector.check(time.monotonic())
        if self._link.modes.resume_waits:
            # What came meanwhile may say that a human has set another mode.
            self._receive(now)
        self._link.tick(now)

    def _receive(self, now: float) -> None:
        for event in self._link.poll(now):
            with self._error_guard.survived(type(event).__name__, now):
                self._handle(event, now)

    def sees_or_reports_fault(self, now: float) -> bool:
        """Whether the turn was a sound one: the link sends, and what it reports of the view is true.

        Without fresh judged frames the heartbeat must say fault or off. The watchdog counts on this.
        """
        if self._link.sent_at < self._turned_at:
            return False
        return self.calls.reason_filter.fresh(now) or self._reported_state in (State.FAULT, State.OFF)

    def leave(self) -> None:
        """End in good order: hand a hold that needs our setpoint stream over to the autopilot's own mode.

        Then write everything that waits.
        """
        self._shadow.log_totals()
        until = time.monotonic() + _LEAVE_WITHIN
        self.calls.holding.release(time.monotonic())
        while self.calls.holding.offboard_release is not None and time.monotonic() < until:
            self.turn()
        self.persistence.leave()
        self.records.leave(self.status())

    def write_status(self, **more: Any) -> dict[str, Any]:
        """Queue the status file, and return its content. more: figures of parts that are not the daemon's."""
        figures = self.records.write_status({**self.status(), **more})
        self.recording.status(figures, time.monotonic())
        return figures

    def status(self) -> dict[str, Any]:
        """Return the figures of the status file."""
        return self._status.figures(time.monotonic())

    @property
    def computer(self) -> Computer:
        """The figures of this computer. Measure them in another thread: a sensor may take its time."""
        return self._status.computer

    def told(self) -> str:
        """Return the text of the open call or hold, else why nothing is judged, else what is repeated."""
        fault = "" if self.calls.current_id else self._health.fault(time.monotonic())
        return fault or self._link.repeated_text

    def ahead(self) -> dict[str, Any] | None:
        """Return what was judged of the way ahead, see `Status.ahead`."""
        return self._status.ahead(self._view, time.monotonic())

    def state_file(self) -> dict[str, Any]:
        """Return the figures for /state.json."""
        return self._status.state_file(time.monotonic())

    def _wait(self) -> None:
        rest = min(_SHORTEST_TURN, TICK) - (time.monotonic() - self._turned_at)
        if rest > 0:
            time.sleep(rest)
        wait(self._link, self._vision, min(TICK, self._link.wait(time.monotonic())))
        self._turned_at = time.monotonic()

    def _handle(self, event: InboundEvent, now: float) -> None:
        self.recording.received(event, now)
        match event:
            case VehicleUpdate(vehicle):
                self._handle_vehicle(vehicle, now)
            case ParameterRequest() | ResetRequest() | Answer(via=Via.TEXT):
                self._finish_answer(self.settings.set(event, now), now)
            case Answer() if any(isinstance(one, IncidentRequest) for one in event.operations):
                self._pack_incident(event, now)
            case Answer() if self.test_call.receive(event, now):
                pass
            case Answer():
                self._finish_answer(self.answer_handler.receive(event, now), now)
            case PolicyRequest():
                self._executor.carry_out(self.settings.policy.command(event, now), now)
            case ScriptHold():
                self.calls.monitor.script_hold_reported(event)
            case ModeAnswer():
                self._executor.carry_out(self.calls.mode_answered(event, now), now)
            case RcChannels():
                self._executor.carry_out(self.settings.policy.rc_channels_received(event, now), now)

    def _pack_incident(self, answer: Answer, now: float) -> None:
        """Have an incident packed, or no more. That answers no call, and teaches nothing."""
        match answer.operations:
            case (PackIncident(call_id),) if answer.motion is Motion.NONE:
                result, text = self.pack_incident(call_id, now)
            case (CancelIncident(call_id),) if answer.motion is Motion.NONE:
                result, text = self.cancel_incident(call_id, now)
            case _:
                result, text = (
                    AckResult.REFUSED,
                    "an incident file is asked for alone, without motion or words",
                )
        ack = Acknowledgement.without_figures(answer.transaction, 0, result, text)
        self._link.acknowledge(answer, replace(ack, words=words_hash(self._vision.words)), now)
        log.info("incident file: %s %s", ack.result.name, ack.text)

    def _handle_vehicle(self, vehicle: Vehicle, now: float) -> None:
        travelled = self._odometer.travelled(vehicle.position)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type, self.calls.numbers.px4_hold)
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
        self._executor.carry_out(self.calls.vehicle_reported(report, now), now)

    def _check_course(self, now: float) -> None:
        """Report to the state machine whether the vehicle drives where its camera does not look.

        Standing still ends no such fault in our hold: only a go does, or a human's mode.
        """
        calls, before = self.calls, self._course.told
        # After a mission that is complete it may roll back a little as it stops.
        drives = calls.monitor.drives_itself(now) and not calls.monitor.newest.mission_ended
        held = calls.hold is not None and calls.go_at is None
        told = self._course.judge(self._link.vehicle, now, drives=drives, held=held)
        if told != before:
            self._executor.carry_out(calls.fault_reported(Fault.COURSE, told, now), now, at_once=True)
        if told:
            calls.holding.require_go(anew=not before)

    def _handle_result(self, result: VisionResult, now: float) -> None:
        match result.report:
            case FrameJudged() as judged:
                self._judged(judged, result.memory, now)
            case Done() as done:
                self._applied(done, result, now)
            case Drawn() as drawn if self.live_picture.drawn(drawn) or self.video_pictures.drawn(drawn):
                pass
            case Drawn() as drawn:
                self.records.drawn(drawn)
            case Encoded() as encoded:
                self.recording.encoded(encoded)

    def _judged(self, judged: FrameJudged, memory: Memory, now: float) -> None:
        seen = judged.assessment
        self._status.frame_judged(judged)
        self.persistence.save_memory(memory)
        self.records.forget_lost_frames()
        # A frame judged by words that a power loss may still undo can hold the vehicle, not release it.
        memory_stored = self.persistence.memory_stored(now, memory)
        self._executor.carry_out(
            self.calls.assessed(seen, now, memory_stored=memory_stored), now, at_once=True
        )
        if seen.adopted is not None:
            self.answer_handler.place_matched(now)
            text = self._report_match(memory.adoption, seen, now)
            self.records.draw(seen, self.calls.state(now), text)
        elif judged.update is not None and (scenes := memory.history) and not scenes[-1].call_id:
            # it has become the first reference
            self.records.first_scene(seen, scenes[-1], self.calls.state(now))
        if self.records.replace_lost_frame(seen):
            self._link.send_text(texts.frame_lost(self.calls.current_id), WARNING, now)
        if seen.dropped:
            self._link.send_text(notices.out_of_use(", ".join(seen.dropped)), NOTICE, now)
        for word in self._weak_words.new(self._vision.weak, memory.preferences):
            self._link.send_text(notices.weak_word(word), NOTICE, now)
        state = self.calls.state(now)
        self.live_picture.judged(seen, state)
        self.video_pictures.judged(seen, state, now)
        self._link.camera.size = video_size(*seen.frame.image.shape[:2])
        self._link.summary(
            summary(seen, judged.sectors, state, self.calls.policy, self.calls.current_id, self._view, now),
            now,
        )
        if seen.roi is not None:
            figures = {"AT_TRAV": seen.roi.traversability, "AT_UNC": seen.roi.uncertainty}
            if seen.similarity is not None:
                figures["AT_SIM"] = seen.similarity
            self._link.numbers({**figures, "AT_CALL": float(self.calls.current_id)}, now)
        self.records.frame_judged(judged)
        self.recording.judged(judged, state, now)

    def _report_match(self, adoption: Adoption | None, seen: Assessment, now: float) -> str:
        """Report which scene matched, and with which words. Returns the first text."""
        if adoption is None:
            return ""
        text = notices.known_place(adoption.call_id, adoption.similarity)
        words = notices.matched_words(adoption.call_id, adoption.preferences, seen.words)
        log.info("%s", "; ".join([text, *words]))
        for line in (text, *words):
            self._link.send_text(line, INFO, now)
        return text

    def _applied(self, done: Done, result: VisionResult, now: float) -> None:
        self.persistence.save_memory(result.memory)
        if self.records.is_call_frame(result.token):
            self.records.call_frame_judged(done)
            return
        handled = self.answer_handler.applied(done, result, now)
        if handled.refused:
            self._link.send_text(notices.refused(handled.refused), ERROR, now)
        self._finish_answer(handled, now)
        for text in handled.notices:
            log.warning("%s", text)
            self.persistence.after_write(partial(self._tell_turned, text))
        self.persistence.after_write(lambda stored, now: self.settings.answered(done, result, stored, now))
        call = self.calls.call
        if call is not None and done.outcome is not None:
            title = f"C{call.id} " + ("answered" if call.answered else "still open")
            self.records.call_judged_again(call, self.calls.state(now), title)

    def _tell_turned(self, text: str, _stored: bool, now: float) -> None:
        self._link.send_text(text, NOTICE, now)

    def _finish_answer(self, handled: Handled, now: float) -> None:
        """Carry out the decisions of an answer and acknowledge it.

        An acknowledgement of a change waits until the change is on disk.
        """
        self._executor.carry_out(handled.decisions, now)
        for reply in handled.replies:
            if reply.changed:
                self.records.answered(reply)
                self.persistence.after_write(partial(self._after_answer_write, reply))
            else:
                ack = reply.acknowledgement
                self._link.acknowledge(reply.answer, ack, now)
                self.recording.acknowledged(ack, now)
                self.pointing.answered(reply.answer, ack, now)
                log.info("answer to %d: %s %s", ack.target, ack.result.name, ack.text)

    def _after_answer_write(self, reply: Reply, stored: bool, now: float) -> None:
        self._finish_answer(self.answer_handler.written(reply, remembered=stored, now=now), now)

    def _report(self, now: float) -> None:
        settings = {
            "policy": self.settings.policy.state.saved(),
            "settings": self.settings.overrides.saved(),
            "shadow": self.settings.statistics.saved(self.calls.shadow, now),
        }
        self.persistence.save_calls(settings, now)
        open_id = self.calls.current_id or self.test_call.id
        self._reported_state = self.calls.state(now)
        accepted = self.calls.fault_accepted(now)
        self._link.set_state(self._reported_state, open_id, self.calls.policy, fault_accepted=accepted)
        self._link.computer(self.computer.newest, now)
        alert = self._active_alert.compose(
            self._vision.words,
            self.position.place(),
            self.records.picture_of(open_id),
            self._health.silent(now),
            now,
        )
        # Only one text is repeated at a time: the most urgent.
        if alert is not None:
            self._link.announce(alert.data, alert.text, now, quiet=alert.quiet, severity=alert.severity)
        elif self.test_call.id:
            self.test_call.announce(now)
        elif self.calls.policy is Policy.OFF:
            self._link.announce(None, notices.off(self.settings.policy.state.off_by), now)
        elif reminder := self._health.reminder():
            self._link.announce(None, reminder, now)
        elif self.calls.policy is Policy.HOLD and (reminder := self._link.dead_man.reminder):
            self._link.announce(None, reminder, now, quiet=True)
        else:
            self._link.announce(None, self.settings.policy.reminder, now, quiet=True, severity=WARNING)
        if self.persistence.memory_stored(now, self._vision.memory):
            self.settings.send_changes(now)


def _packs_nothing(_call: int, _now: float) -> tuple[AckResult, str]:
    return AckResult.REFUSED, "nothing is packed here"
