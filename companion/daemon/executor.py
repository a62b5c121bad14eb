"""Carries out what the state machine decided, before anybody is told of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import replace

from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    Decision,
    HoldMoved,
    HoldRenamed,
    HoldShown,
    HoldStarted,
    ResumeCancelled,
    SetMode,
    WouldHold,
    WouldResume,
)
from companion.calls.hold import HoldEvent
from companion.calls.machine import OperatorCalls
from companion.daemon.call_frames import CallFrames
from companion.daemon.health import STALLED_AFTER
from companion.daemon.persistence import Persistence
from companion.daemon.policy.shadow_statistics import ShadowStatistics
from companion.daemon.turn import Decided, Event
from companion.link.mode_commands import ModeCommands
from companion.system.error_guard import ErrorGuard

_OVER = (HoldEvent.RESUMED, HoldEvent.TAKEN_OVER, HoldEvent.DROPPED, HoldEvent.CONFIRMED, HoldEvent.REBOOTED)
"""What makes a mode that waits to be sent outdated."""


class DecisionExecutor:
    """Carries out decisions one by one, each guarded, so that a failing picture does not prevent a hold."""

    def __init__(
        self,
        modes: ModeCommands,
        frames: CallFrames,
        persistence: Persistence,
        statistics: ShadowStatistics,
        calls: OperatorCalls,
        fault_name: Callable[[float], str],
        error_guard: ErrorGuard,
        events: list[Event],
    ) -> None:
        """fault_name: see `HealthMonitor.fault_name`. events: what happens in a turn, in order."""
        self._modes = modes
        self._frames = frames
        self._persistence = persistence
        self._statistics = statistics
        self._calls = calls
        self._fault_name = fault_name
        self.error_guard = error_guard
        self.events = events
        self._hold_to_show: HoldShown | None = None

    def carry_out(self, decisions: Iterable[Decision], now: float, *, at_once: bool = False) -> None:
        """Carry out all decisions: modes first, since drawing and storing take time, then the rest in order.

        at_once: send a new hold before the rest is done. Only allowed when all messages of the autopilot were
        handled: one that waits may say that a human has taken over.
        """
        decisions = list(decisions)
        for decision in decisions:
            with self.error_guard.survived(type(decision).__name__, now):
                self._send_mode(decision, now)
        if at_once:
            self.send_hold_now(now)
        at = self._persistence.stamp()
        for decision in decisions:
            with self.error_guard.survived(Decided.__name__, now):
                self.events.append(self._decided(decision, now, at))
            with self.error_guard.survived(type(decision).__name__, now):
                self._do(decision, now, at)
        if at_once:
            with self.error_guard.survived(HoldShown.__name__, now):
                self._show_hold(now)

    def send_hold_now(self, now: float) -> None:
        """Send a decided hold now, unless the process stalled since `now`: a human may have taken over."""
        if time.monotonic() - now <= STALLED_AFTER:
            self._modes.send_hold_now(now)

    def _send_mode(self, decision: Decision, now: float) -> None:
        match decision:
            case HoldMoved() if decision.event in _OVER:
                self._modes.cancel()
            case ResumeCancelled():
                self._modes.cancel()
            case SetMode(mode, expected, hold):
                self._modes.command(mode, now, expected=expected, hold=hold)

    def _decided(self, decision: Decision, now: float, at: float) -> Decided:
        """Return the decision for those who are told of it at the end of the turn."""
        match decision:
            case CallOpened(call) | CallClosed(call):
                decision = replace(decision, call=replace(call, reasons=set(call.reasons)))
            case HoldStarted(hold) | HoldMoved(hold) | HoldShown(hold) | HoldRenamed(_, hold):
                decision = replace(decision, hold=copy(hold))
        return Decided(decision, self._calls.monitor.newest, self._fault_name(now), at)

    def _do(self, decision: Decision, now: float, at: float) -> None:
        match decision:
            case CallOpened(call):
                self._frames.call_opened(call, now)
            case CallClosed(call):
                self._persistence.save_closed_call(call, at)
            case HoldShown():
                self._hold_to_show = decision
            case WouldHold():
                self._statistics.began(decision, at)
            case WouldResume():
                self._statistics.ended(decision)

    def _show_hold(self, now: float) -> None:
        """Store a picture of a new hold. Called only after the hold's mode was sent: drawing takes time."""
        shown, self._hold_to_show = self._hold_to_show, None
        if shown is not None:
            self._frames.hold_shown(shown, now)
