"""A byte budget."""

from __future__ import annotations


class TokenBucket:
    """Over any t seconds at most `rate` x t + `burst` bytes pass. Rate 0: unlimited. Full at the start."""

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._level = burst
        self._at = now

    def affords(self, size: float, now: float) -> bool:
        """Whether `size` bytes may pass at `now`."""
        return self._rate == 0 or self._filled(now) >= size

    def take(self, size: float, now: float) -> bool:
        """Let `size` bytes pass, or say that they may not yet."""
        if not self.affords(size, now):
            return False
        if self._rate:
            self._level = self._filled(now) - size
            self._at = max(now, self._at)
        return True

    def set_rate(self, rate: float, now: float) -> None:
        """Bytes per second from now on; what has gathered stays."""
        self._level, self._at, self._rate = self._filled(now), max(now, self._at), rate

    def _filled(self, now: float) -> float:
        return min(self._burst, self._level + max(0.0, now - self._at) * self._rate)
