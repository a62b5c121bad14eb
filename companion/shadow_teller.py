"""Tells of shadow policy: each would-be hold as it comes, and what they add up to now and then."""

from __future__ import annotations

import logging
import math
import time

from companion.calls.decisions import WouldHold, WouldResume
from companion.calls.machine import OperatorCalls
from companion.keeper import Keeper
from companion.link.link import Link
from companion.shadow_book import ShadowBook
from companion.wire import notices
from companion.wire.ids import Policy

log = logging.getLogger(__name__)

WARNING, NOTICE = 4, 5
TEXT_GAP = 10.0
"""Seconds at least between two texts of would-be holds: their running numbers tell of those between."""
LOG_EVERY, TEXT_EVERY = 600.0, 1800.0
"""Seconds watched between two sums in the log, and to the operator."""


class ShadowTeller:
    """Writes the book, and tells of it within bounds."""

    def __init__(self, book: ShadowBook, calls: OperatorCalls, link: Link, keeper: Keeper) -> None:
        self._book = book
        self._calls = calls
        self._link = link
        self._keeper = keeper
        self._text_at = -math.inf
        self._logged = self._told = calls.shadow.watched

    def began(self, hold: WouldHold, now: float) -> None:
        """A would-be hold begins; the call has its own picture, where there is one."""
        self._book.began(hold, time.time())
        text = notices.would_hold(hold.number, sorted(reason.value for reason in hold.reasons))
        log.warning("shadow: %s", text)
        if now - self._text_at >= TEXT_GAP:
            self._text_at = now
            self._link.say(text, WARNING, now)
        newest = self._calls.sight.newest
        if newest is not None and self._calls.call is None:
            self._keeper.picture(newest, self._calls.state(now), text)

    def ended(self, hold: WouldResume) -> None:
        """It is over."""
        self._book.ended(hold)
        how = "by hand" if hold.by_hand else "frames are OK"
        log.warning("shadow: S%d over after %.1f s: %s", hold.number, hold.lasted, how)

    def tick(self, now: float) -> None:
        """The sums, when they are due."""
        if self._calls.policy is not Policy.SHADOW:
            return
        shadow = self._calls.shadow
        if shadow.watched < self._told:
            self._logged = self._told = shadow.watched
        if shadow.watched - self._logged >= LOG_EVERY:
            self._logged = shadow.watched
            log.info("shadow: %s", self._book.line(shadow))
        if shadow.watched - self._told >= TEXT_EVERY:
            self._told = shadow.watched
            self._link.say(self._book.text(shadow), NOTICE, now)

    def last(self) -> None:
        """The daemon ends."""
        if self._calls.shadow.watched:
            log.info("shadow: %s", self._book.line(self._calls.shadow))
