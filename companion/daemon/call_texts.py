"""Tells operators of calls and holds: repeats what is open, and says once what changed."""

from __future__ import annotations

import logging

from anytraverse.memory import Memory
from companion.calls.active_alert import ActiveAlert
from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    FaultAcceptanceEnds,
    FaultAccepted,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldStarted,
    Unasked,
)
from companion.calls.hold import Hold, HoldEvent
from companion.calls.machine import OperatorCalls
from companion.calls.mode_monitor import ModeReport
from companion.daemon.health import WeakWords
from companion.daemon.records import Records
from companion.daemon.turn import CallShown, Decided, Event, Observer, Turn
from companion.link.alerts import AlertRepeater, TextSender
from companion.system.error_guard import FatalError
from companion.vision.client import VisionResult
from companion.vision.messages import FrameJudged
from companion.wire import notices, texts
from companion.wire.ids import ALERT, ERROR, INFO, NOTICE, WARNING, Kind, Outcome

log = logging.getLogger(__name__)

_ENDS = {
    HoldEvent.RESUMED: Outcome.ANSWERED,
    HoldEvent.TAKEN_OVER: Outcome.TAKEN_OVER,
    HoldEvent.DROPPED: Outcome.SWITCHED_OFF,
}


class CallTexts(Observer):
    """Observes decisions and judged frames, and what is open. Only the most urgent text is repeated."""

    def __init__(
        self, sender: TextSender, alerts: AlertRepeater, calls: OperatorCalls, records: Records
    ) -> None:
        """records: has the picture by which a call or hold is shown."""
        self._sender = sender
        self._alerts = alerts
        self._calls = calls
        self._records = records
        self._active_alert = ActiveAlert(calls)
        self._weak_words = WeakWords()
        self.told = ""
        """The text of the open call or hold, else why nothing is judged, else what is repeated."""

    def see(self, turn: Turn) -> None:
        """Repeat what is open now. Raises FatalError where that cannot be told: nobody would know of it."""
        picture = self._records.picture_of(turn.current_id)
        try:
            alert = self._active_alert.compose(turn.words, turn.place, picture, [*turn.silent], turn.now)
        except Exception as error:
            raise FatalError(f"the alert of the open call or hold failed: {error!r}") from error
        if alert is not None:
            self._alerts.announce(
                alert.data, alert.text, turn.now, quiet=alert.quiet, severity=alert.severity
            )
        else:
            text, severity, quiet, data = turn.reminder
            self._alerts.announce(data, text, turn.now, quiet=quiet, severity=severity)
        self.told = ("" if turn.current_id else turn.fault) or self._alerts.repeated

    def happened(self, event: Event, turn: Turn) -> None:
        """Say what changed."""
        match event:
            case Decided():
                self._decided(event, turn)
            case CallShown(number, replaced=True):
                self._send(texts.frame_lost(number), WARNING, turn)
            case VisionResult(FrameJudged() as judged, memory):
                self._judged(judged, memory, turn)

    def _decided(self, decided: Decided, turn: Turn) -> None:
        decision, report, fault, _ = decided
        match decision:
            case CallOpened(call):
                log.warning("call %d: %s", call.id, ", ".join(sorted(r.value for r in call.reasons)))
                self._active_alert.call_opened(call)
                if turn.policy.holds and report.mission_over:
                    self._send(texts.not_held(call.id), NOTICE, turn)
            case CallClosed(call):
                log.info("call %d closed: %s", call.id, call.outcome.name.lower())
                data = self._active_alert.closed_call(call, turn.words, turn.place, turn.now)
                self._alerts.announce(data, texts.closed(Kind.CALL, call.id, call.outcome), turn.now)
            case HoldStarted(hold, reasons, unasked):
                why = sorted(r.value for r in reasons) + ([unasked.value] if unasked is not None else [])
                log.warning("hold %d: %s", hold.id, ", ".join(why))
                if unasked is not None:
                    mode, kind = report.mode_name(hold.mode_before), self._active_alert.kind_of(hold.id)
                    text_of = texts.overrode if unasked is Unasked.OVERRODE else texts.rebooted_into
                    self._send(text_of(kind, hold.id, mode), ALERT, turn)
            case HoldRenamed(old, hold):
                log.info("hold %d goes on as call %d", old, hold.id)
                self._close_hold(old, Outcome.NONE, turn)
            case HoldMoved():
                self._hold_moved(decision, report, turn)
            case GoLapsed(number):
                self._send(texts.go_lapsed(self._active_alert.kind_of(number), number), WARNING, turn)
            case FaultAccepted():
                self._fault_accepted(decision, report, fault, turn)
            case FaultAcceptanceEnds(seconds, metres):
                self._send(texts.fault_acceptance_ends(seconds, metres, fault), ERROR, turn)

    def _judged(self, judged: FrameJudged, memory: Memory, turn: Turn) -> None:
        """Tell which scene matched, and with which words, and what vision said of the words in use."""
        seen, adoption = judged.assessment, memory.adoption
        if seen.adopted is not None and adoption is not None:
            text = notices.known_place(adoption.call_id, adoption.similarity)
            words = notices.matched_words(adoption.call_id, adoption.preferences, seen.words)
            log.info("%s", "; ".join([text, *words]))
            for line in (text, *words):
                self._send(line, INFO, turn)
        if seen.dropped:
            self._send(notices.out_of_use(", ".join(seen.dropped)), NOTICE, turn)
        for word in self._weak_words.new(turn.weak, memory.preferences):
            self._send(notices.weak_word(word), NOTICE, turn)

    def _hold_moved(self, moved: HoldMoved, report: ModeReport, turn: Turn) -> None:
        hold, autopilot = moved.hold, report.autopilot
        kind = self._active_alert.kind_of(hold.id)
        log.info("hold %d: %s", hold.id, moved.event.value)
        ended = _ENDS.get(moved.event)
        if ended is not None and kind is Kind.HOLD:
            self._close_hold(hold.id, ended, turn)
        match moved.event:
            case HoldEvent.CONFIRMED:
                circles = autopilot is not None and autopilot.circles
                text_of = texts.circling if circles else texts.holding
                self._send(text_of(kind, hold.id), WARNING, turn)
            case HoldEvent.FAILED if moved.resuming:
                self._send(texts.resume_failed(kind, hold.id), ALERT, turn)
            case HoldEvent.FAILED:
                self._send(texts.hold_failed(kind, hold.id), ALERT, turn)
            case HoldEvent.RESUMED:
                self._send(texts.resumed(kind, hold.id, report.mode_name(hold.mode_before)), NOTICE, turn)
                if autopilot is not None and hold.mode_before in autopilot.loses_target:
                    self._send(texts.send_target_again(), ERROR, turn)
                if autopilot is not None and hold.mode_before in autopilot.mission_modes:
                    self._report_mission(kind, hold, turn)
            case HoldEvent.TAKEN_OVER:
                mode = report.mode or 0
                itself = autopilot is not None and mode in autopilot.by_itself
                taken = texts.taken_from_us if itself else texts.taken_over
                self._send(taken(kind, hold.id, report.mode_name(mode)), NOTICE, turn)
            case HoldEvent.REBOOTED:
                self._send(texts.rebooted(kind, hold.id), WARNING, turn)
            case HoldEvent.MISSION_OVER:
                mode_before = report.mode_name(hold.mode_before)
                self._send(texts.mission_over(kind, hold.id, mode_before), WARNING, turn)
            case HoldEvent.DROPPED:
                self._send(texts.dropped(kind, hold.id), WARNING, turn)

    def _fault_accepted(self, accepted: FaultAccepted, report: ModeReport, what: str, turn: Turn) -> None:
        kind = self._active_alert.kind_of(accepted.id)
        limits = accepted.acceptance
        if limits is None:
            self._send(texts.fault_not_accepted(kind, accepted.id), ERROR, turn)
            return
        seconds, metres = limits.left(self._calls.numbers, turn.now, report.travelled)
        log.warning("a human drives on in spite of a fault: %s", what)
        self._send(texts.fault_accepted(kind, accepted.id, what, seconds, metres), ERROR, turn)

    def _report_mission(self, kind: Kind, hold: Hold, turn: Turn) -> None:
        """Report what somebody changed in the mission during the hold. It goes on with its current item."""
        held = hold.interrupted
        if held.now is not None and (held.replaced or held.moved):
            text_of = texts.mission_replaced if held.replaced else texts.mission_moved
            self._send(text_of(kind, hold.id, held.now.item), NOTICE, turn)

    def _close_hold(self, number: int, outcome: Outcome, turn: Turn) -> None:
        data = self._active_alert.closed_hold(number, outcome, turn.words, turn.place, turn.now)
        self._alerts.announce(data, texts.closed(Kind.HOLD, number, outcome), turn.now)

    def _send(self, text: str, severity: int, turn: Turn) -> None:
        self._sender.send(text, severity, turn.now)
