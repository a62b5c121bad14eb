"""Has judged frames drawn while somebody watches the page or the video, one at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

from anytraverse.assessment import Assessment
from companion.daemon.call_texts import CallTexts
from companion.daemon.pointing import Pointing
from companion.daemon.turn import Observer, Turn
from companion.vision.client import VisionClient, VisionResult
from companion.vision.messages import Drawn, VideoMarks
from companion.wire.ids import State
from companion.wire.texts import REASONS

_SHOWN_AGAIN = 1.0
"""Seconds after which a still picture is given to the video again, which else says that it is old."""
_DRAWN_AGAIN = 1.0
"""Seconds after which a still picture is requested again when it could not be drawn."""
_STRAINED_PERIOD = 1.0
"""Seconds between two live pictures while the computer is too slow or hot to judge at its full rate."""
LEGEND = "green: drivable, red: not, violet: unknown"


class ShownFrame(NamedTuple):
    """A drawn frame. captured_at: monotonic seconds. jpeg: the panel, or the video's picture.

    number: of a still picture of the video, 0 for others.
    """

    frame: int
    captured_at: float
    jpeg: bytes
    number: int = 0


class _Drawing:
    """Has one picture drawn at a time."""

    def __init__(self, vision: VisionClient) -> None:
        self._vision = vision
        self._asked: tuple[int, ShownFrame] | None = None
        """Number of the request, and what it will give, yet without jpeg."""
        self._restarts = 0
        """Restarts of vision when it was asked: a request before the last of them is lost."""

    @property
    def busy(self) -> bool:
        return self._asked is not None and self._vision.watchdog.restarted == self._restarts

    def ask(
        self, seen: Assessment, title: str, state: State, video: VideoMarks | None = None, number: int = 0
    ) -> bool:
        """Request a picture, unless one is being drawn. Whether it did. number: of `ShownFrame`."""
        frame = seen.frame
        if self.busy or not self._vision.draw(frame.id, title, state, video=video, roi=seen.roi):
            return False
        self._asked = self._vision.newest_request, ShownFrame(frame.id, frame.captured_at, b"", number)
        self._restarts = self._vision.watchdog.restarted
        return True

    def drawn(self, turn: Turn) -> ShownFrame | None:
        """Return the picture that was requested here, once it was drawn in this turn."""
        for event in turn.events:
            match event:
                case VisionResult(Drawn(number, panel=panel)) if self._asked and number == self._asked[0]:
                    shown, self._asked = self._asked[1], None
                    return shown._replace(jpeg=panel) if panel else None
        return None


def _title(seen: Assessment, state: State) -> str:
    reasons = ", ".join(sorted(REASONS[reason.value] for reason in seen.reasons))
    return f"{state.name}{': ' if reasons else ''}{reasons}"


class LivePicture(Observer):
    """Requests a picture of the next judged frame when one is wanted, and keeps it until it is taken."""

    def __init__(self, vision: VisionClient) -> None:
        self._drawing = _Drawing(vision)
        self._wanted = False
        self._drawn: ShownFrame | None = None

    def want(self) -> None:
        """Have the next judged frame drawn."""
        self._wanted = True

    def take(self) -> ShownFrame | None:
        """Return the newest picture once."""
        drawn, self._drawn = self._drawn, None
        return drawn

    def see(self, turn: Turn) -> None:
        """Take a picture that was drawn, and request one of a judged frame, if one is wanted."""
        self._drawn = self._drawing.drawn(turn) or self._drawn
        for judged in turn.judged:
            seen = judged.assessment
            if self._wanted and not self._drawing.busy:
                self._drawing.ask(seen, _title(seen, turn.state), turn.state)
                self._wanted = False


class _Still(NamedTuple):
    """What a still picture shows. It is drawn anew when this changes."""

    seen: Assessment
    title: str
    state: State
    marks: VideoMarks
    number: int


class VideoPictures(Observer):
    """Has the pictures of the video drawn: the newest judged frame, at most `rate` times a second.

    While a call or a blocked hold is open, it is that one's frame, still, so that what is tapped is what is
    meant.

    watched: whether somebody watches. Nothing is drawn for nobody.
    """

    def __init__(self, vision: VisionClient, pointing: Pointing, texts: CallTexts, rate: float) -> None:
        """texts: has the text of what is open, or of what is wrong. rate: pictures per second."""
        self._vision = vision
        self._drawing = _Drawing(vision)
        self._pointing = pointing
        self._texts = texts
        self._period = 0.9 / rate
        self._asked_at = self._taken_at = -math.inf
        self._still: _Still | None = None
        """The still picture that was requested last, None while live ones are."""
        self._complete = False
        """Whether the picture that was requested last was drawn."""
        self._drawn: ShownFrame | None = None
        self._new = False
        self.watched = False

    def see(self, turn: Turn) -> None:
        """Take a picture that was drawn, and request the next one where it is time for one."""
        if (picture := self._drawing.drawn(turn)) is not None:
            self._drawn, self._new, self._complete = picture, True, True
        self._show_still(turn.state, turn.now)
        for judged in turn.judged:
            self._show_live(judged.assessment, turn.state, turn.now)

    def _show_still(self, state: State, now: float) -> None:
        """Request the still picture when a call opens, when it changes, and when it could not be drawn."""
        if not self.watched:
            self._still = self._drawn = None
            return
        subject = self._pointing.subject(now)
        if subject is None:
            self._still = None
            return
        if self._drawing.busy or not self._vision.watchdog.running:
            return
        still = _Still(subject, self._texts.told, state, self._pointing.marks(), self._pointing.picture())
        if still == self._still and (self._complete or now - self._asked_at < _DRAWN_AGAIN):
            return
        self._drawing.ask(*still)
        self._still, self._complete, self._asked_at = still, False, now

    def _show_live(self, seen: Assessment, state: State, now: float) -> None:
        """Request a picture of this frame where it is time for one, and none is shown still."""
        period = max(self._period, _STRAINED_PERIOD) if self._vision.rate.why else self._period
        if not self.watched or self._still is not None or now - self._asked_at < period:
            return
        title = self._texts.told or _title(seen, state)
        if self._drawing.ask(seen, title, state, VideoMarks(note=LEGEND)):
            self._complete, self._asked_at = False, now

    def take(self, now: float) -> ShownFrame | None:
        """Return a new picture once, and a still one once a second.

        While vision hangs no tap can be judged: then the video says that its picture is old.
        """
        still = self._still is not None and self._complete and self._vision.watchdog.responsive
        again = still and now - self._taken_at >= _SHOWN_AGAIN
        if self._drawn is None or not (self._new or again):
            return None
        self._new, self._taken_at = False, now
        return self._drawn
