"""Carries out what the state machine decided: sets modes, sends texts, stores records and pictures."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable

from companion.calls.active_alert import ActiveAlert
from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    Decision,
    FaultAcceptanceEnds,
    FaultAccepted,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldShown,
    HoldStarted,
    ResumeCancelled,
    SetMode,
    Unasked,
    WouldHold,
    WouldResume,
)
from companion.calls.hold import Hold, HoldEvent
from companion.calls.machine import OperatorCalls
from companion.daemon.health import STALLED_AFTER
from companion.daemon.policy.shadow_reporter import ShadowReporter
from companion.daemon.recording import Recording
from companion.daemon.records import Records
from companion.link.link import Link
from companion.system.error_guard import ErrorGuard
from companion.vehicle.state import VehiclePosition
from companion.vision.client import VisionClient
from companion.wire import texts
from companion.wire.ids import ALERT, ERROR, NOTICE, WARNING, Kind, Outcome, Policy

log = logging.getLogger(__name__)

_ENDS = {
    HoldEvent.RESUMED: Outcome.ANSWERED,
    HoldEvent.TAKEN_OVER: Outcome.TAKEN_OVER,
    HoldEvent.DROPPED: Outcome.SWITCHED_OFF,
}


class DecisionExecutor:
    """Carries out decisions one by one, each guarded, so that a failing picture does not prevent a hold."""

    def __init__(
        self,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        records: Records,
        active_alert: ActiveAlert,
        error_guard: ErrorGuard,
        position: VehiclePosition,
        shadow: ShadowReporter,
        recording: Recording,
        fault_name: Callable[[float], str],
    ) -> None:
        """fault_name: names the fault that stands at a time, see `HealthMonitor.fault_name`."""
        self._link = link
        self._vision = vision
        self._calls = calls
        self._records = records
        self._active_alert = active_alert
        self._error_guard = error_guard
        self._position = position
        self._shadow = shadow
        self._recording = recording
        self._fault_name = fault_name
        self._hold_to_show: HoldShown | None = None

    def carry_out(self, decisions: Iterable[Decision], now: float, *, at_once: bool = False) -> None:
        """Carry out all decisions: modes first, since drawing and storing take time, then the rest in order.

        at_once: send a new hold before the rest is done. Only allowed when all messages of the autopilot were
        handled: one that waits may say that a human has taken over.
        """
        decisions = list(decisions)
        for decision in decisions:
            with self._error_guard.survived(type(decision).__name__, now):
                self._send_mode(decision, now)
        if at_once:
            self.send_hold_now(now)
        for decision in decisions:
            with self._error_guard.survived(type(decision).__name__, now):
                self._do(decision, now)
        self._recording.decided(decisions, now)
        if at_once:
            with self._error_guard.survived(HoldShown.__name__, now):
                self._show_hold(now)

    def send_hold_now(self, now: float) -> None:
        """Send a decided hold now, unless the process stalled since `now`: a human may have taken over."""
        if time.monotonic() - now <= STALLED_AFTER:
            self._link.modes.send_hold_now(now)

    def _send_mode(self, decision: Decision, now: float) -> None:
        match decision:
            case HoldMoved() if decision.event in (*_ENDS, HoldEvent.CONFIRMED, HoldEvent.REBOOTED):
                self._link.modes.cancel()
            case ResumeCancelled():
                self._link.modes.cancel()
            case SetMode(mode, expected, hold):
                self._link.modes.command(mode, now, expected=expected, hold=hold)

    def _do(self, decision: Decision, now: float) -> None:
        match decision:
            case CallOpened(call):
                log.warning("call %d: %s", call.id, ", ".join(sorted(r.value for r in call.reasons)))
                self._active_alert.call_opened(call)
                call.place = self._position.place()
                self._records.call_opened(call, self._calls.state(now))
                if self._calls.policy is Policy.HOLD and self._calls.monitor.newest.mission_over:
                    self._link.send_text(texts.not_held(call.id), NOTICE, now)
            case CallClosed(call):
                log.info("call %d closed: %s", call.id, call.outcome.name.lower())
                data = self._active_alert.closed_call(call, self._vision.words, self._position.place(), now)
                self._link.announce(data, texts.closed(Kind.CALL, call.id, call.outcome), now)
                self._records.call_closed(call)
            case HoldStarted(hold, reasons, unasked):
                why = sorted(r.value for r in reasons) + ([unasked.value] if unasked is not None else [])
                log.warning("hold %d: %s", hold.id, ", ".join(why))
                if unasked is not None:
                    mode, kind = self._mode_name(hold.mode_before), self._active_alert.kind_of(hold.id)
                    text_of = texts.overrode if unasked is Unasked.OVERRODE else texts.rebooted_into
                    self._link.send_text(text_of(kind, hold.id, mode), ALERT, now)
            case HoldShown():
                self._hold_to_show = decision
            case HoldRenamed(old, hold):
                log.info("hold %d goes on as call %d", old, hold.id)
                self._close_hold(old, Outcome.NONE, now)
            case HoldMoved():
                self._hold_moved(decision, now)
            case GoLapsed(number):
                self._link.send_text(texts.go_lapsed(self._calls.kind, number), WARNING, now)
            case FaultAccepted():
                self._fault_accepted(decision, now)
            case FaultAcceptanceEnds(seconds, metres):
                text = texts.fault_acceptance_ends(seconds, metres, self._fault_name(now))
                self._link.send_text(text, ERROR, now)
            case WouldHold():
                self._shadow.began(decision, now)
            case WouldResume():
                self._shadow.ended(decision)

    def _show_hold(self, now: float) -> None:
        """Store a picture of a new hold. Called only after the hold's mode was sent: drawing takes time."""
        shown, self._hold_to_show = self._hold_to_show, None
        if shown is not None and shown.hold is self._calls.hold and self._calls.call is None:
            self._records.hold_shown(shown.hold.id, shown.seen, self._calls.state(now))

    def _hold_moved(self, moved: HoldMoved, now: float) -> None:
        hold, autopilot = moved.hold, self._calls.monitor.newest.autopilot
        kind = self._active_alert.kind_of(hold.id)
        log.info("hold %d: %s", hold.id, moved.event.value)
        ended = _ENDS.get(moved.event)
        if ended is not None and kind is Kind.HOLD:
            self._close_hold(hold.id, ended, now)
        match moved.event:
            case HoldEvent.CONFIRMED:
                circles = autopilot is not None and autopilot.circles
                text_of = texts.circling if circles else texts.holding
                self._link.send_text(text_of(kind, hold.id), WARNING, now)
            case HoldEvent.FAILED if moved.resuming:
                self._link.send_text(texts.resume_failed(kind, hold.id), ALERT, now)
            case HoldEvent.FAILED:
                self._link.send_text(texts.hold_failed(kind, hold.id), ALERT, now)
            case HoldEvent.RESUMED:
                self._link.send_text(
                    texts.resumed(kind, hold.id, self._mode_name(hold.mode_before)), NOTICE, now
                )
                if autopilot is not None and hold.mode_before in autopilot.loses_target:
                    self._link.send_text(texts.send_target_again(), ERROR, now)
                if autopilot is not None and hold.mode_before in autopilot.mission_modes:
                    self._report_mission(kind, hold, now)
                newest = self._calls.reason_filter.newest
                if newest is not None:
                    title = f"{texts.name(kind, hold.id)} drives on"
                    self._records.draw(newest, self._calls.state(now), title)
            case HoldEvent.TAKEN_OVER:
                mode = self._calls.monitor.newest.mode or 0
                itself = autopilot is not None and mode in autopilot.by_itself
                taken = texts.taken_from_us if itself else texts.taken_over
                self._link.send_text(taken(kind, hold.id, self._mode_name(mode)), NOTICE, now)
            case HoldEvent.REBOOTED:
                self._link.send_text(texts.rebooted(kind, hold.id), WARNING, now)
            case HoldEvent.MISSION_OVER:
                mode_before = self._mode_name(hold.mode_before)
                self._link.send_text(texts.mission_over(kind, hold.id, mode_before), WARNING, now)
            case HoldEvent.DROPPED:
                self._link.send_text(texts.dropped(kind, hold.id), WARNING, now)

    def _fault_accepted(self, accepted: FaultAccepted, now: float) -> None:
        kind = self._active_alert.kind_of(accepted.id)
        limits = accepted.acceptance
        if limits is None:
            self._link.send_text(texts.fault_not_accepted(kind, accepted.id), ERROR, now)
            return
        seconds, metres = limits.left(self._calls.numbers, now, self._calls.monitor.newest.travelled)
        what = self._fault_name(now)
        log.warning("a human drives on in spite of a fault: %s", what)
        self._link.send_text(texts.fault_accepted(kind, accepted.id, what, seconds, metres), ERROR, now)

    def _report_mission(self, kind: Kind, hold: Hold, now: float) -> None:
        """Report what somebody changed in the mission during the hold. It goes on with its current item."""
        held = hold.interrupted
        if held.now is not None and (held.replaced or held.moved):
            text_of = texts.mission_replaced if held.replaced else texts.mission_moved
            self._link.send_text(text_of(kind, hold.id, held.now.item), NOTICE, now)

    def _mode_name(self, mode: int) -> str:
        return self._calls.monitor.newest.mode_name(mode)

    def _close_hold(self, number: int, outcome: Outcome, now: float) -> None:
        data = self._active_alert.closed_hold(
            number, outcome, self._vision.words, self._position.place(), now
        )
        self._link.announce(data, texts.closed(Kind.HOLD, number, outcome), now)
