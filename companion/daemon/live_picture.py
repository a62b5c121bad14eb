"""Has the newest judged frame drawn for somebody who watches: one at a time, and none for nobody."""

from __future__ import annotations

from typing import NamedTuple

from anytraverse.assessment import Assessment
from companion.vision.client import VisionClient
from companion.vision.messages import Drawn
from companion.wire.ids import State


class Shown(NamedTuple):
    """A drawn frame. captured_at: monotonic seconds. jpeg: the panel."""

    frame: int
    captured_at: float
    jpeg: bytes


class LivePicture:
    """Requests a picture of the next judged frame when one is wanted, and keeps it until it is taken."""

    def __init__(self, vision: VisionClient) -> None:
        self._vision = vision
        self._wanted = False
        self._asked: tuple[int, int, float] | None = None
        """Number of the request, id and capture time of its frame."""
        self._restarts = 0
        """Restarts of vision when it was asked: a request before the last of them is lost."""
        self._drawn: Shown | None = None

    def want(self) -> None:
        """Have the next judged frame drawn."""
        self._wanted = True

    def take(self) -> Shown | None:
        """Return the newest picture once."""
        drawn, self._drawn = self._drawn, None
        return drawn

    def judged(self, seen: Assessment, state: State) -> None:
        """Request a picture of this frame, if one is wanted and none is being drawn."""
        restarts = self._vision.watchdog.restarted
        if not self._wanted or (self._asked is not None and restarts == self._restarts):
            return
        reasons = ", ".join(sorted(reason.value.replace("_", " ") for reason in seen.reasons))
        title = f"{state.name}{': ' if reasons else ''}{reasons}"
        asked = self._vision.draw(seen.frame.id, title, state)
        request = self._vision.newest_request, seen.frame.id, seen.frame.captured_at
        self._asked = request if asked else None
        self._wanted, self._restarts = False, restarts

    def drawn(self, drawn: Drawn) -> bool:
        """Take a picture, if it was requested here. Whether it was."""
        if self._asked is None or drawn.number != self._asked[0]:
            return False
        _, frame, captured_at = self._asked
        self._asked = None
        if drawn.panel:
            self._drawn = Shown(frame, captured_at, drawn.panel)
        return True
