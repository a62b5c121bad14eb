"""Finds frames of a live stream that are old when they arrive, since they waited in a buffer. No clock."""

from __future__ import annotations

import math

DROPPED_AFTER_A_GAP = 3
"""Frames after a gap that are dropped at least: a decoder still holds them from before it."""
_USUAL_SHARE = 0.1
_CATCHING_UP = 0.5
CAME_LATE = "a picture came late: check cable or network, and the frames/s of the camera"
DRIFT = 2e-4
"""s per s by which the clocks of a camera and of this computer may differ."""
_JUMP = 5.0


class LateFrames:
    """Says which frames came late: those after a gap in which nothing arrived, until the backlog is gone.

    The backlog is gone after `DROPPED_AFTER_A_GAP` frames, once they do not come faster than usual.
    """

    def __init__(self, limit: float) -> None:
        """limit: s between two frames above which those that follow are suspect."""
        self._limit = limit
        self._arrived: float | None = None
        self._usual: float | None = None
        self._suspect = 0
        self._until = -math.inf

    def is_late(self, now: float) -> bool:
        """Whether the frame that arrives `now`, in monotonic s, may be older than it seems."""
        before, self._arrived = self._arrived, now
        if before is None:
            return False
        interval = now - before
        if interval > self._limit:
            self._suspect = DROPPED_AFTER_A_GAP
            self._until = now + interval  # what came in the gap is read faster than it came
        if self._suspect > 0:
            self._suspect -= 1
            return True
        if now < self._until and (self._usual is None or interval < _CATCHING_UP * self._usual):
            return True
        self._until = -math.inf
        usual = interval if self._usual is None else self._usual
        self._usual = usual + _USUAL_SHARE * (interval - usual)
        return False


class StreamClock:
    """Finds a frame's delay beyond the shortest one seen, from the stream's time stamps."""

    def __init__(self) -> None:
        self._offset = math.inf
        self._arrived = self._position = -math.inf

    def delay(self, arrived: float, position: float) -> float:
        """Return the frame's extra delay in s, 0 or more.

        arrived: monotonic s. position: the frame's time stamp in s, from any start. A stamp that goes back or
        jumps ahead by more than 5 s starts anew, since the camera has set its clock.
        """
        if not math.isfinite(position):
            return 0.0
        ahead = (position - self._position) - (arrived - self._arrived)
        if position < self._position or ahead > _JUMP:
            self._offset = math.inf
        elif math.isfinite(self._offset):
            self._offset += DRIFT * (arrived - self._arrived)
        self._arrived, self._position = arrived, position
        self._offset = min(self._offset, arrived - position)
        return arrived - position - self._offset
