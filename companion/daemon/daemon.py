"""The daemon's main loop: hear, decide, keep, say. Fifty times a second, and whenever something arrives."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from companion.answers.handler import AnswerHandler, Heard, Reply
from companion.calls.machine import OperatorCalls
from companion.daemon.executor import DecisionExecutor
from companion.daemon.health import HealthMonitor, StallDetector, WeakWords
from companion.daemon.persistence import Persistence
from companion.daemon.startup import wait
from companion.daemon.status import Status
from companion.daemon.test_call import TestCall
from companion.link import inbound as radio
from companion.link.inbound import AnswerRequest, ModeAck, PolicyRequest, Pulses, VehicleHeard
from companion.link.link import Link
from companion.policy.shadow import ShadowReporter
from companion.settings.service import SettingsService
from companion.system.error_guard import ErrorGuard
from companion.tasks import Liveness
from companion.telemetry.active_alert import ActiveAlert
from companion.telemetry.summary import summary
from companion.vehicle import known_autopilot
from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.position import Odometer
from companion.vehicle.state import Vehicle, VehiclePosition, is_moving
from companion.vision.client import Applied, Judged, Result, Vision
from companion.vision.messages import Drawn, Model
from companion.wire import notices, texts
from companion.wire.ids import Policy, State

log = logging.getLogger(__name__)

TICK = 0.02
_REST = 0.005
"""Seconds between two turns at least: whoever sends many datagrams does not get a turn for each."""
ALERT, ERROR, WARNING, NOTICE, INFO = 1, 3, 4, 5, 6
_FAREWELL, _FAREWELL_STEP = 15, 0.02
_LEAVING = 4.0


class Daemon:
    """Ties the parts together; each of them knows nothing of the others.

    `turn` is one round of the main loop and waits for at most `TICK` seconds. An error in hearing, judging or
    carrying out is survived and said; one in deciding ends the daemon, which must not look alive then.
    """

    def __init__(
        self,
        link: Link,
        vision: Vision,
        calls: OperatorCalls,
        persistence: Persistence,
        answer_handler: AnswerHandler,
        desk: SettingsService,
        liveness: Liveness,
        model: Model,
        view: int = 0,
    ) -> None:
        """model: what judges. view: the camera's horizontal field of view, degrees, 0 where not known."""
        self._link = link
        self._vision = vision
        self._calls = calls
        self._persistence = persistence
        self._answer_handler = answer_handler
        self._desk = desk
        self._weak_words = WeakWords()
        self._view = view
        self._active_alert = ActiveAlert(calls)
        self._odometer = Odometer()
        self.whereabouts = VehiclePosition(lambda: link.vehicle)
        place = self.whereabouts.place
        persistence.stamp = self.whereabouts.clock.stamp
        self._error_guard = ErrorGuard(lambda now: link.say(notices.unexpected_error(), ERROR, now))
        self._watch = HealthMonitor(liveness, link, vision, calls, persistence)
        self._shadow = ShadowReporter(desk.book, calls, link, persistence.picture)
        self._acting = DecisionExecutor(
            link,
            calls,
            persistence,
            self._active_alert,
            self._error_guard,
            lambda: answer_handler.words,
            place,
            self._shadow,
        )
        self._trial = TestCall(persistence.folder, calls, link, lambda: answer_handler.words, place)
        self._status = Status(link, vision, calls, answer_handler, desk, self._trial, model)
        self._stall_detector = StallDetector(link, calls, time.monotonic())
        desk.when_kept(persistence.when_kept)
        self._turned_at = time.monotonic()

    def turn(self) -> None:
        """Hear all, decide, stop, carry out, have it kept, say what may be said; no disk is waited for."""
        self._wait()
        now = time.monotonic()
        self._stall_detector.look(now)
        for heard in self._link.poll(now):
            with self._error_guard.survived(type(heard).__name__, now):
                self._hear(heard, now)
        self._acting.hurry(now)
        self._vision.situation(
            self.whereabouts.place(),
            now,
            moving=is_moving(self._link.vehicle, drives_itself=self._calls.autopilot.drives_itself),
        )
        for result in self._vision.poll(now):
            with self._error_guard.survived(type(result).__name__, now):
                self._take_result(result, now)
        for say, kept in self._persistence.due(now):
            with self._error_guard.survived("acknowledgement", now):
                say(kept, now)
        self._watch.look(now)
        self._desk.policy.tick(now)
        self._shadow.tick(now)
        self._acting.carry_out(self._calls.tick(now), now, at_once=True)
        self._trial.tick(now)
        self._link.stand_still(on=self._calls.holding.streams)
        self._speak(now)
        self._stall_detector.look(time.monotonic())
        self._link.tick(now)

    def leave(self) -> None:
        """The daemon ends in good order: a hold that stands on our setpoints is handed to the autopilot."""
        self._shadow.last()
        until = time.monotonic() + _LEAVING
        self._calls.holding.leave(time.monotonic())
        while self._calls.holding.handover is not None and time.monotonic() < until:
            self.turn()

    def farewell(self) -> None:
        """The daemon cannot go on: let the autopilot's script and the operator know at once."""
        autopilot = self._calls.autopilot.autopilot
        if autopilot is not None and self._calls.holding.streams:
            self._link.set_mode(autopilot.rest_mode, time.monotonic())
        self._link.set_state(State.FAULT, self._calls.current_id, self._calls.policy)
        self._link.say(notices.dying(), ALERT, time.monotonic())
        for _ in range(_FAREWELL):
            self._link.tick(time.monotonic())
            time.sleep(_FAREWELL_STEP)

    def status(self) -> dict[str, Any]:
        """Figures for the status file."""
        return self._status.figures(time.monotonic())

    def _wait(self) -> None:
        rest = min(_REST, TICK) - (time.monotonic() - self._turned_at)
        if rest > 0:
            time.sleep(rest)
        wait(self._link, self._vision, min(TICK, self._link.wait(time.monotonic())))
        self._turned_at = time.monotonic()

    def _hear(self, heard: radio.Heard, now: float) -> None:
        match heard:
            case VehicleHeard(vehicle):
                self._hear_vehicle(vehicle, now)
            case AnswerRequest() if self._trial.hear(heard, now):
                pass
            case AnswerRequest():
                self._take(self._answer_handler.hear(heard, now), now)
            case radio.ParameterRequest() | radio.WordsRequest() | radio.ResetRequest():
                self._take(self._desk.set(heard, now), now)
            case PolicyRequest():
                self._acting.carry_out(self._desk.policy.command(heard, now), now)
            case ScriptHold():
                self._calls.holding.script_told = heard
            case ModeAck(accepted=False):
                log.info("the autopilot says no to a mode: MAV_RESULT %d", heard.result)
            case Pulses():
                self._acting.carry_out(self._desk.policy.hear(heard, now), now)

    def _hear_vehicle(self, vehicle: Vehicle, now: float) -> None:
        travelled = self._odometer.travelled(vehicle.position)
        autopilot = known_autopilot(vehicle.autopilot, vehicle.type, self._calls.numbers.px4_hold)
        decisions = self._desk.policy.reckon(autopilot, now)
        decisions += self._calls.vehicle(
            vehicle.custom_mode, vehicle.armed, now, travelled, vehicle.heard_at, autopilot
        )
        self._acting.carry_out(decisions, now)

    def _take_result(self, result: Result, now: float) -> None:
        match result:
            case Judged():
                self._judged(result, now)
            case Applied():
                self._applied(result, now)
            case Drawn():
                self._persistence.drawn(result, self._calls)

    def _judged(self, judged: Judged, now: float) -> None:
        seen = judged.assessment
        self._status.took = judged.took
        self._status.latencies.append(seen.age)
        self._answer_handler.words = judged.memory.preferences
        self._persistence.save_memory(judged.memory)
        self._persistence.miss_frames(self._calls)
        settled = self._persistence.settled(now, judged.memory)
        self._acting.carry_out(self._calls.assessed(seen, now, settled=settled), now, at_once=True)
        if seen.adopted is not None:
            text = notices.known_place(seen.adopted.call_id)
            log.info("%s (similarity %.3f)", text, seen.match.similarity if seen.match else 0.0)
            self._link.say(text, INFO, now)
            self._persistence.picture(seen, self._calls.state(now), text)
        if self._persistence.replace_lost_frame(self._calls, seen, now):
            self._link.say(texts.frame_lost(self._calls.current_id), WARNING, now)
        if seen.dropped:
            self._link.say(notices.out_of_use(", ".join(seen.dropped)), NOTICE, now)
        for word in self._weak_words.new(self._vision.weak, judged.memory.preferences):
            self._link.say(notices.weak_word(word), NOTICE, now)
        state = self._calls.state(now)
        self._link.summary(
            summary(seen, judged.sectors, state, self._calls.policy, self._calls.current_id, self._view, now),
            now,
        )
        if seen.roi is not None:
            figures = {"AT_TRAV": seen.roi.traversability, "AT_UNC": seen.roi.uncertainty}
            if seen.similarity is not None:
                figures["AT_SIM"] = seen.similarity
            self._link.numbers({**figures, "AT_CALL": float(self._calls.current_id)}, now)
        self._persistence.judged(seen, judged.at)

    def _applied(self, applied: Applied, now: float) -> None:
        self._persistence.save_memory(applied.memory)
        if self._persistence.is_call_frame(applied.token):
            self._persistence.reseen(self._calls, applied, now)
            return
        heard = self._answer_handler.applied(applied, now)
        if heard.refused:
            self._link.say(notices.refused(heard.refused), ERROR, now)
        self._take(heard, now)
        self._persistence.when_kept(lambda _, now: self._desk.answered(applied, now))
        call = self._calls.call
        if call is not None and applied.outcome is not None:
            title = f"C{call.id} " + ("answered" if call.answered else "still open")
            self._persistence.call_judged_again(call, self._calls.state(now), title)

    def _take(self, heard: Heard, now: float) -> None:
        """Carry out what an answer led to; an acknowledgement waits until all that it says is on disk."""
        self._acting.carry_out(heard.decisions, now)
        for reply in heard.replies:
            if reply.changed:
                self._persistence.answered(reply)
                self._persistence.when_kept(partial(self._kept, reply))
            else:
                ack = reply.acknowledgement
                self._link.acknowledge(reply.request, ack, now)
                log.info("answer to %d: %s %s", ack.target, ack.result.name, ack.text)

    def _kept(self, reply: Reply, remembered: bool, now: float) -> None:
        self._take(self._answer_handler.kept(reply, remembered=remembered, now=now), now)

    def _speak(self, now: float) -> None:
        beside = {
            "policy": self._desk.policy.saved(),
            "settings": self._desk.overrides.saved(),
            "shadow": self._desk.book.saved(self._calls.shadow, now),
        }
        self._persistence.save_calls(self._calls, beside, now)
        open_id = self._calls.current_id or self._trial.id
        self._link.set_state(self._calls.state(now), open_id, self._calls.policy)
        said = self._active_alert.now(
            self._answer_handler.words,
            self.whereabouts.place(),
            self._persistence.picture_of(open_id),
            self._watch.silent(now),
            now,
        )
        if said is not None:
            self._link.announce(said.data, said.text, now, quiet=said.quiet, severity=said.severity)
        elif self._trial.id:
            self._trial.announce(now)
        elif self._calls.policy is Policy.OFF:
            self._link.announce(None, notices.off(self._desk.policy.off_by), now)
        elif reminder := self._watch.reminder():
            self._link.announce(None, reminder, now)
        else:
            self._link.announce(None, self._desk.policy.reminder, now, quiet=True, severity=WARNING)
        if self._persistence.settled(now):
            self._desk.tell_changes(self._answer_handler.words, now)


def stop_on_signals() -> Callable[[], bool]:
    """Becomes true on SIGTERM or SIGINT."""
    told: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda caught, _: told.append(caught))
    return lambda: bool(told)
