"""Measures how fast the replies to file requests come, and so how long to wait for one."""

from __future__ import annotations

from dataclasses import dataclass

FIRST_BACK_OFF_S = 0.4
"""How long to wait for the first reply."""
SHORTEST_PATIENCE_S = 0.3
FRAMES_MISSED = 3
"""A burst is over when nothing came for the time of so many of its frames."""


@dataclass
class ReplyPace:
    """Measures how fast replies come, in s.

    mean, deviation: from a request to its reply, smoothed as TCP does (RFC 6298). frame: from one frame of a
    burst to the next, 0 while not known.
    """

    mean: float = FIRST_BACK_OFF_S / 3
    deviation: float = FIRST_BACK_OFF_S / 6
    frame: float = 0.0
    _newest: tuple[int, float] | None = None
    _requested: float = 0.0

    @property
    def patience(self) -> float:
        """Seconds of silence after which all that is under way is taken for lost."""
        return max(self.mean + 4 * self.deviation, FRAMES_MISSED * self.frame, SHORTEST_PATIENCE_S)

    @property
    def probe(self) -> float:
        """Seconds after which the last missing part is read once more, before it is known to be lost."""
        return max(self.patience / 2, FRAMES_MISSED * self.frame)

    def begin_burst(self, now: float) -> None:
        """Note that a burst was requested."""
        self._newest, self._requested = None, now

    def reply_took(self, seconds: float) -> None:
        """Take in the time from a request to its reply."""
        self.deviation += (abs(seconds - self.mean) - self.deviation) / 4
        self.mean += (seconds - self.mean) / 8

    def frame_came(self, sequence: int, now: float) -> None:
        """Take in a frame of a burst. The sequence numbers tell how many were lost between."""
        if self._newest is None:
            self.reply_took(now - self._requested)
        elif 0 < (frames := sequence - self._newest[0] & 0xFFFF) < 0x8000:
            one = (now - self._newest[1]) / frames
            self.frame += (one - self.frame) / (4 if self.frame else 1)
        self._newest = sequence, now
