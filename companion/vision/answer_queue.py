"""Holds answers until it is their turn, so that new frames are judged meanwhile."""

from __future__ import annotations

import math
from collections import deque

from companion.vision.messages import Apply, Restore

WITHOUT_FRAMES = 0.5
"""Seconds between two requests where no new frame comes."""


class AnswerQueue:
    """Gives out the requests that make frames be judged again, the oldest first.

    They take at most as long as judging new frames: after each one, a new frame must have been judged, and as
    much time must have passed as the request took. Else many answers, whoever sends them, would blind the
    rover. Times are monotonic seconds.
    """

    def __init__(self) -> None:
        self._waiting: deque[Apply | Restore] = deque()
        self._is_judged = True
        self._ended_at = self._free_at = -math.inf

    def add(self, request: Apply | Restore) -> None:
        """Add a request. The supervisor bounds how many wait."""
        self._waiting.append(request)

    def take(self, now: float) -> Apply | Restore | None:
        """Return the request whose turn it is, and remove it; None for none."""
        in_turn = self._is_judged or now >= self._ended_at + WITHOUT_FRAMES
        return self._waiting.popleft() if self._waiting and in_turn and now >= self._free_at else None

    def handled(self, began: float, now: float) -> None:
        """Note that a request was handled from `began` until `now`."""
        self._is_judged, self._ended_at, self._free_at = False, now, 2 * now - began

    def judged(self) -> None:
        """Note that a new frame was judged."""
        self._is_judged = True
