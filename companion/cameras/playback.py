"""Delays the reading of files, so that they play at a fixed rate like a live camera."""

from __future__ import annotations

import time

from companion.cameras import NoFrameYet


class PlaybackPace:
    """Lets a reader through `rate` times a second. It never speeds up to make up for lost time."""

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._due = time.monotonic()

    def wait(self, timeout: float) -> float:
        """Wait until the next frame is due, and return time.monotonic() then.

        Raises NoFrameYet when it is not due within `timeout` seconds.
        """
        left = self._due - time.monotonic()
        if left > 0:
            time.sleep(min(left, timeout))
        if left > timeout:
            raise NoFrameYet(f"the next picture is due in {left - timeout:.1f} s: read again")
        now = time.monotonic()
        fell_behind = now - self._due >= self._period
        self._due = self._period + (now if fell_behind else self._due)
        return now
