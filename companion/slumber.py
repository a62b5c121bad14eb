"""A process that was stopped wakes with a queue of old news, the autopilot's mode among them."""

from __future__ import annotations

import logging

from companion.calls.machine import OperatorCalls
from companion.link.link import Link

log = logging.getLogger(__name__)

ASLEEP = 1.0
"""Seconds between two looks after which we count as having slept."""


class Slumber:
    """Notices that we slept; then nothing that was heard or waits to be heard is believed.

    A human may have taken over meanwhile: nothing is commanded until the autopilot has told its mode anew,
    which takes a second at most. What operators sent is lost, as on a bad link, and asked for again.
    """

    def __init__(self, link: Link, calls: OperatorCalls, now: float) -> None:
        self._link = link
        self._calls = calls
        self._awake_at = now

    def look(self, now: float) -> None:
        """Before anything is heard, and before anything leaves: whatever may have kept us waiting between."""
        slept, self._awake_at = now - self._awake_at, now
        if slept > ASLEEP:
            log.warning("the companion stood still for %.1f s: busy, stopped or starved", slept)
            self._link.skip(now)
            self._link.forget_mode()
            self._calls.holding.forget(now, slept)
