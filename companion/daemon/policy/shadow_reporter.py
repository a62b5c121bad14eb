"""Reports the shadow policy's would-be holds to the log and to the operator, at limited rates."""

from __future__ import annotations

import logging
import math

from companion.calls.decisions import WouldHold, WouldResume
from companion.daemon.policy.shadow_statistics import ShadowStatistics
from companion.daemon.turn import Decided, Event, Observer, Turn
from companion.link.alerts import TextSender
from companion.wire import notices
from companion.wire.ids import NOTICE, WARNING, Policy

log = logging.getLogger(__name__)

TEXT_GAP = 10.0
"""Least seconds between two texts about would-be holds. Their running numbers show how many were skipped."""
LOG_EVERY, TEXT_EVERY = 600.0, 1800.0
"""Seconds watched between two totals in the log, and to the operator."""


class ShadowReporter(Observer):
    """Observes would-be holds, and reports them and the totals at limited rates."""

    def __init__(self, statistics: ShadowStatistics, sender: TextSender) -> None:
        self._statistics = statistics
        self._sender = sender
        self._text_at = -math.inf
        self._watched_at_log = self._watched_at_text = statistics.shadow.watched

    def happened(self, event: Event, turn: Turn) -> None:
        """Report would-be holds."""
        match event:
            case Decided(WouldHold() as hold):
                self._began(hold, turn.now)
            case Decided(WouldResume() as hold):
                self._ended(hold)

    def see(self, turn: Turn) -> None:
        """Report the totals when they are due."""
        if turn.policy is Policy.SHADOW:
            self._report_totals(turn.now)

    def _began(self, hold: WouldHold, now: float) -> None:
        text = notices.would_hold(hold.number, sorted(reason.value for reason in hold.reasons))
        log.warning("shadow: %s", text)
        if now - self._text_at >= TEXT_GAP:
            self._text_at = now
            self._sender.send(text, WARNING, now)

    def _ended(self, hold: WouldResume) -> None:
        how = "by hand" if hold.by_hand else "frames are OK"
        log.warning("shadow: S%d over after %.1f s: %s", hold.number, hold.lasted, how)

    def _report_totals(self, now: float) -> None:
        shadow = self._statistics.shadow
        # The counts were reset.
        if shadow.watched < self._watched_at_text:
            self._watched_at_log = self._watched_at_text = shadow.watched
        if shadow.watched - self._watched_at_log >= LOG_EVERY:
            self._watched_at_log = shadow.watched
            log.info("shadow: %s", self._statistics.line())
        if shadow.watched - self._watched_at_text >= TEXT_EVERY:
            self._watched_at_text = shadow.watched
            self._sender.send(self._statistics.text(), NOTICE, now)

    def log_totals(self) -> None:
        """Log the totals at the daemon's end."""
        if self._statistics.shadow.watched:
            log.info("shadow: %s", self._statistics.line())
