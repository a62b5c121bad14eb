"""Reports the shadow policy's would-be holds to the log and to the operator, at limited rates."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from anytraverse.assessment import Assessment
from companion.calls.decisions import WouldHold, WouldResume
from companion.calls.machine import OperatorCalls
from companion.daemon.policy.shadow_statistics import ShadowStatistics
from companion.link.link import Link
from companion.wire import notices
from companion.wire.ids import NOTICE, WARNING, Policy, State

log = logging.getLogger(__name__)

TEXT_GAP = 10.0
"""Least seconds between two texts about would-be holds. Their running numbers show how many were skipped."""
LOG_EVERY, TEXT_EVERY = 600.0, 1800.0
"""Seconds watched between two totals in the log, and to the operator."""


class ShadowReporter:
    """Feeds the statistics, and reports would-be holds and totals at limited rates."""

    def __init__(
        self,
        statistics: ShadowStatistics,
        calls: OperatorCalls,
        link: Link,
        picture: Callable[[Assessment, State, str], None],
        stamp: Callable[[], float],
    ) -> None:
        """picture: stores a picture of a judged frame, with a title. stamp: the time, see `WallClock`."""
        self._statistics = statistics
        self._calls = calls
        self._link = link
        self._picture = picture
        self._stamp = stamp
        self._text_at = -math.inf
        self._watched_at_log = self._watched_at_text = calls.shadow.watched

    def began(self, hold: WouldHold, now: float) -> None:
        """Record and report the begin of a would-be hold, with a picture unless a call has its own."""
        self._statistics.began(hold, self._stamp())
        text = notices.would_hold(hold.number, sorted(reason.value for reason in hold.reasons))
        log.warning("shadow: %s", text)
        if now - self._text_at >= TEXT_GAP:
            self._text_at = now
            self._link.send_text(text, WARNING, now)
        newest = self._calls.reason_filter.newest
        if newest is not None and self._calls.call is None:
            self._picture(newest, self._calls.state(now), text)

    def ended(self, hold: WouldResume) -> None:
        """Record and log the end of a would-be hold."""
        self._statistics.ended(hold)
        how = "by hand" if hold.by_hand else "frames are OK"
        log.warning("shadow: S%d over after %.1f s: %s", hold.number, hold.lasted, how)

    def tick(self, now: float) -> None:
        """Report the totals when they are due."""
        if self._calls.policy is not Policy.SHADOW:
            return
        shadow = self._calls.shadow
        # The counts were reset.
        if shadow.watched < self._watched_at_text:
            self._watched_at_log = self._watched_at_text = shadow.watched
        if shadow.watched - self._watched_at_log >= LOG_EVERY:
            self._watched_at_log = shadow.watched
            log.info("shadow: %s", self._statistics.line(shadow))
        if shadow.watched - self._watched_at_text >= TEXT_EVERY:
            self._watched_at_text = shadow.watched
            self._link.send_text(self._statistics.text(shadow), NOTICE, now)

    def log_totals(self) -> None:
        """Log the totals at the daemon's end."""
        if self._calls.shadow.watched:
            log.info("shadow: %s", self._statistics.line(self._calls.shadow))
