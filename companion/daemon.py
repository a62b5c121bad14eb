"""The daemon's main loop: hear, decide, keep, say. Fifty times a second, and whenever something arrives."""

from __future__ import annotations

import contextlib
import logging
import select
import signal
import time
from collections.abc import Callable, Iterable
from typing import Any

from anytraverse.assessment import Reason
from anytraverse.history import Place
from companion.announcement import Announcement
from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    Decision,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldStarted,
    SetMode,
    WouldHold,
)
from companion.calls.hold import HoldEvent
from companion.calls.machine import OperatorCalls
from companion.cameras.newest import CameraThread
from companion.conversation import Conversation, Heard
from companion.eyes import Applied, Eyes, Judged
from companion.keeper import Keeper
from companion.link.autopilot import GUIDED, mode_name
from companion.link.heard import AnswerRequest, ParameterRequest, Vehicle, VehicleHeard
from companion.link.link import Link
from companion.odometer import Odometer
from companion.settings_desk import SettingsDesk
from companion.tasks import Liveness
from companion.telling import fault_name, summary
from companion.wire import texts
from companion.wire.ids import Kind, Outcome, Policy

log = logging.getLogger(__name__)

TICK = 0.02
ALERT, ERROR, WARNING, NOTICE, INFO = 1, 3, 4, 5, 6
OFF_PERIOD = 60.0


class Daemon:
    """Ties the parts together; each of them knows nothing of the others.

    `turn` is one round of the main loop and blocks for at most `TICK` seconds.
    """

    def __init__(
        self,
        link: Link,
        camera: CameraThread,
        eyes: Eyes,
        calls: OperatorCalls,
        keeper: Keeper,
        conversation: Conversation,
        desk: SettingsDesk,
        liveness: Liveness,
        view: int = 0,
    ) -> None:
        self._link = link
        self._camera = camera
        self._eyes = eyes
        self._calls = calls
        self._keeper = keeper
        self._conversation = conversation
        self._desk = desk
        self._liveness = liveness
        self._view = view
        self._announcement = Announcement(calls)
        self._odometer = Odometer()
        self._replies: list[Heard] = []
        self._faulty = False
        self._off_said_at = float("-inf")

    def turn(self) -> None:
        """Hear everything, decide, carry out, keep, then say: nothing is said that is not kept."""
        self._wait()
        now = time.monotonic()
        for heard in self._link.poll(now):
            match heard:
                case VehicleHeard(vehicle):
                    self._hear_vehicle(vehicle, now)
                case AnswerRequest():
                    self._take(self._conversation.hear(heard, now), now)
                case ParameterRequest():
                    self._take(self._desk.set(heard, now), now)
        for result in self._eyes.results():
            match result:
                case Judged():
                    self._judged(result, now)
                case Applied():
                    self._applied(result, now)
        self._watch(now)
        self._carry_out(self._calls.tick(now), now)
        self._keeper.save_calls(self._calls)
        self._speak(now)
        self._link.tick(now)

    def status(self) -> dict[str, Any]:
        """Figures for the status file."""
        now = time.monotonic()
        newest, camera, counters = self._calls.sight.newest, self._camera.status, self._link.counters
        return {
            "state": self._calls.state(now).name.lower(),
            "reasons": sorted(reason.value for reason in self._calls.sight.reasons(now)),
            "current_id": self._calls.current_id,
            "policy": self._calls.policy.name.lower(),
            "words": self._conversation.words.format(),
            "roi_uncertainty": newest.roi.uncertainty if newest and newest.roi else None,
            "similarity": newest.similarity if newest else None,
            "camera": {
                "state": camera.state.value,
                "reason": camera.reason,
                "read": camera.read,
                "dropped": camera.dropped,
            },
            "link": {"trouble": self._link.trouble, "sent": dict(counters.sent), "lost": counters.lost},
        }

    def _wait(self) -> None:
        readable = [number for number in (self._link.fileno(), self._eyes.fileno()) if number is not None]
        with contextlib.suppress(OSError, ValueError):
            select.select(readable, [], [], min(TICK, self._link.wait(time.monotonic())))

    def _hear_vehicle(self, vehicle: Vehicle, now: float) -> None:
        travelled = self._odometer.travelled(vehicle.position)
        self._carry_out(self._calls.vehicle(vehicle.custom_mode, vehicle.armed, now, travelled), now)

    def _judged(self, judged: Judged, now: float) -> None:
        seen = judged.assessment
        self._keeper.save_memory(judged.memory)
        self._conversation.words = judged.memory.preferences
        self._carry_out(self._calls.assessed(seen, now), now)
        if seen.adopted is not None:
            text = texts.known_place(seen.adopted.call_id)
            log.info("%s (similarity %.3f)", text, seen.match.similarity if seen.match else 0.0)
            self._link.say(text, INFO, now)
            self._keeper.picture(seen, self._calls.state(now), text)
        if seen.dropped:
            self._link.say(texts.out_of_use(", ".join(seen.dropped)), NOTICE, now)
        state = self._calls.state(now)
        region = self._calls.numbers.judging.region
        self._link.summary(
            summary(seen, region, state, self._calls.policy, self._calls.current_id, self._view, now), now
        )
        if seen.roi is not None:
            figures = {"AT_TRAV": seen.roi.traversability, "AT_UNC": seen.roi.uncertainty}
            if seen.similarity is not None:
                figures["AT_SIM"] = seen.similarity
            self._link.numbers({**figures, "AT_CALL": float(self._calls.current_id)}, now)
        self._keeper.judged(seen, judged.at)

    def _applied(self, applied: Applied, now: float) -> None:
        remembered = self._keeper.save_memory(applied.memory)
        if self._keeper.is_call_frame(applied.token):
            self._keeper.reseen(self._calls, applied, now)
            return
        heard = self._conversation.applied(applied, remembered=remembered, now=now)
        if heard.refused:
            self._link.say(texts.refused(heard.refused), ERROR, now)
        self._take(heard, now)
        if isinstance(applied.token, ParameterRequest):
            self._desk.answered(applied.token, applied.memory.preferences, now)
        call = self._calls.call
        if call is not None and call.seen is not None and applied.outcome is not None:
            title = f"C{call.id} " + ("answered" if call.answered else "still open")
            self._keeper.picture(call.seen, self._calls.state(now), title)

    def _take(self, heard: Heard, now: float) -> None:
        """Carry out what an answer led to; its acknowledgement waits until all of it is kept."""
        self._carry_out(heard.decisions, now)
        if heard.replies:
            self._replies.append(heard)

    def _watch(self, now: float) -> None:
        self._liveness.beat("eyes", self._eyes.alive_at)
        if self._camera.delivered_at is not None:
            self._liveness.beat("camera", self._camera.delivered_at)
        reasons = self._calls.sight.reasons(now)
        faulty = Reason.FAULT in reasons
        if faulty != self._faulty:
            self._faulty = faulty
            if faulty:
                why = fault_name(self._calls.sight.newest, self._liveness.silent(now))
                log.error("fault: %s", why)
                if self._calls.current_id == 0:
                    self._link.say(texts.fit(f"Companion FAULT: {why}"), ERROR, now)
            else:
                log.info("sees again")
                self._link.say(texts.recovered(), NOTICE, now)

    def _speak(self, now: float) -> None:
        if self._replies:
            kept = self._keeper.save_calls(self._calls)
            for reply in (reply for heard in self._replies for reply in heard.replies):
                self._link.acknowledge(reply.request, reply.acknowledgement, now)
                self._keeper.answered(reply)
                log.info(
                    "answer to %d: %s %s%s",
                    reply.acknowledgement.target,
                    reply.acknowledgement.result.name,
                    reply.acknowledgement.text,
                    "" if kept else " (not kept)",
                )
            self._replies.clear()
        self._link.set_state(self._calls.state(now), self._calls.current_id)
        place = self.place()
        said = self._announcement.now(
            self._conversation.words, place, self._keeper.call_picture, self._liveness.silent(now), now
        )
        if said is not None:
            self._link.announce(said.data, said.text, now, quiet=said.quiet, severity=said.severity)
        elif self._calls.policy is Policy.OFF:
            self._link.announce(None, texts.off(), now)
        else:
            self._link.announce(None, "", now)
        self._desk.tell_changes(self._conversation.words, now)

    def place(self) -> Place:
        """Where the vehicle is, as far as it says."""
        position = self._link.vehicle.position if self._link.vehicle is not None else None
        latitude, longitude, heading = position or (None, None, None)
        return Place(latitude, longitude, heading, time.time())

    def _carry_out(self, decisions: Iterable[Decision], now: float) -> None:
        for decision in decisions:
            match decision:
                case SetMode(mode):
                    self._link.set_mode(mode, now)
                case CallOpened(call):
                    state = self._calls.state(now)
                    self._keeper.call_opened(call, state)
                    log.warning("call %d: %s", call.id, ", ".join(sorted(r.value for r in call.reasons)))
                case CallClosed(call):
                    log.info("call %d closed: %s", call.id, call.outcome.name.lower())
                    self._keeper.call_closed(call)
                    data = self._announcement.closed_call(call, self._conversation.words, self.place(), now)
                    self._link.announce(data, texts.closed(Kind.CALL, call.id, call.outcome), now)
                case HoldStarted(hold, reasons):
                    log.warning("hold %d: %s", hold.id, ", ".join(sorted(r.value for r in reasons)))
                case HoldRenamed(old, hold):
                    log.info("hold %d goes on as call %d", old, hold.id)
                    self._close_hold(old, Outcome.NONE, now)
                case HoldMoved():
                    self._hold_moved(decision, now)
                case GoLapsed(number):
                    self._link.say(texts.go_lapsed(self._calls.kind, number), WARNING, now)
                case WouldHold(reasons):
                    names = ", ".join(sorted(reason.value for reason in reasons))
                    log.warning("shadow: would have held for %s", names)
                    self._link.say(texts.shadow(self._calls.kind, self._calls.current_id), WARNING, now)

    def _hold_moved(self, moved: HoldMoved, now: float) -> None:
        hold = moved.hold
        of_call = hold.id in {self._announcement.last_call, self._calls.call and self._calls.call.id}
        kind = Kind.CALL if of_call else Kind.HOLD
        log.info("hold %d: %s", hold.id, moved.event.value)
        newest = self._calls.sight.newest
        match moved.event:
            case HoldEvent.CONFIRMED:
                self._link.say(texts.holding(kind, hold.id), WARNING, now)
            case HoldEvent.FAILED if moved.resuming:
                self._link.say(texts.resume_failed(kind, hold.id), ALERT, now)
            case HoldEvent.FAILED:
                self._link.say(texts.hold_failed(kind, hold.id), ALERT, now)
            case HoldEvent.RESUMED:
                self._link.say(texts.resumed(kind, hold.id, mode_name(hold.mode_before)), NOTICE, now)
                if hold.mode_before == GUIDED:
                    self._link.say(texts.send_target_again(), ERROR, now)
                if newest is not None:
                    self._keeper.picture(
                        newest, self._calls.state(now), f"{texts.name(kind, hold.id)} drives on"
                    )
            case HoldEvent.TAKEN_OVER:
                mode = mode_name(self._calls.autopilot.mode or 0)
                self._link.say(texts.taken_over(kind, hold.id, mode), NOTICE, now)
        ended = {
            HoldEvent.RESUMED: Outcome.ANSWERED,
            HoldEvent.TAKEN_OVER: Outcome.TAKEN_OVER,
            HoldEvent.DROPPED: Outcome.SWITCHED_OFF,
        }.get(moved.event)
        if ended is not None and kind is Kind.HOLD:
            self._close_hold(hold.id, ended, now)

    def _close_hold(self, number: int, outcome: Outcome, now: float) -> None:
        data = self._announcement.closed_hold(number, outcome, self._conversation.words, self.place(), now)
        self._link.announce(data, texts.closed(Kind.HOLD, number, outcome), now)


def stop_on_signals() -> Callable[[], bool]:
    """Becomes true on SIGTERM or SIGINT."""
    told: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda caught, _: told.append(caught))
    return lambda: bool(told)
