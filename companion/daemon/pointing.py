"""Turns a tap in the video into an answer to the call or hold whose frame the video shows."""

from __future__ import annotations

import math
from collections.abc import Callable

from anytraverse.assessment import Assessment
from anytraverse.operations import Tap
from anytraverse.regions import Box
from companion.calls.machine import OperatorCalls
from companion.calls.summary import place_of
from companion.daemon.answers.handler import Reply
from companion.daemon.answers.outcome import stale_text
from companion.daemon.turn import Event, Observer, Turn
from companion.link.camera import Tapped
from companion.link.link import Link
from companion.vision.messages import VideoMarks
from companion.wire import texts
from companion.wire.answers import COMMANDS, Acknowledgement, Answer
from companion.wire.ids import CHANGING_RESULTS, Kind, Motion, Stage
from companion.wire.parameters import NOT_IN_USE, OBSTACLE, TAP_WORD

HALF = 0.06
"""Half the width and height, as shares of the picture, of the box around a point outside the call's place."""
STILL_AFTER_TAP = 5.0
"""Seconds for which the video still shows a call's frame after a tap has covered it."""


class Pointing(Observer):
    """Knows which frame may be tapped, and what was tapped in it.

    shown_for: for how many seconds the video has shown a still picture, by its number; 0 where it does not.
    """

    def __init__(self, calls: OperatorCalls, link: Link) -> None:
        self._calls = calls
        self._link = link
        self._taps: tuple[Box, ...] = ()
        self._tapped = 0
        """Id of the call or hold that `_taps` belong to."""
        self._tapped_at = -math.inf
        self._current = 0
        self._meant: tuple[object, ...] = ()
        self._picture = 0
        self.shown_for: Callable[[int, float], float] = lambda _picture, _now: 0.0
        link.camera.resolve = self.resolve

    @property
    def word(self) -> tuple[str, float]:
        """Word and weight that the next tap means, by AT_TAP_WORD."""
        entry = self._link.parameters.at(int(self._link.parameters.value(TAP_WORD)))
        if entry is None or entry.word is None:
            return OBSTACLE
        return entry.word, OBSTACLE[1] if entry.value == NOT_IN_USE else entry.value

    def subject(self, now: float) -> Assessment | None:
        """Return the frame that the video shows still: that of what waits for an answer, None without one."""
        waits = self._calls.stage() is Stage.OPEN or now - self._tapped_at < STILL_AFTER_TAP
        return self._seen() if waits else None

    def picture(self) -> int:
        """Return the number of the still picture, 1 or more.

        It is another one as soon as a tap in it means another frame, place, word or weight.
        """
        seen = self._seen()
        meant = (seen and seen.frame.id, self._place(), self.word)
        if meant != self._meant:
            self._meant, self._picture = meant, self._picture + 1
        return self._picture

    def marks(self) -> VideoMarks:
        """Return what is marked in that frame."""
        word, weight = self.word
        if self._calls.stage() is not Stage.OPEN:
            note = "Tapped. Now go, or stay"
        elif self._taps:
            note = f"Not covered. Tap it again ({word} {weight:g}), or go, or stay"
        else:
            note = f"Tap it: {word} {weight:g}. Then go, or stay"
        return VideoMarks(self._place(), self._taps, f"STILL PICTURE. {note}")

    def resolve(self, tapped: Tapped, now: float) -> Answer | str:
        """Return the answer that is meant by what was tapped, without its sender, or why it means none."""
        number = self._calls.resolve(0, now)
        if number is None:
            return stale_text(self._calls, 0)
        seen, kind = self._seen(), self._calls.kind
        if seen is None:
            return texts.fit(f"{texts.name(kind, number)} has no picture to tap in: go or stay")
        if self.subject(now) is None:
            return texts.needs_no_tap(kind, number)
        if self.shown_for(self.picture(), now) < self._calls.numbers.announce_guard:
            return texts.not_shown(kind, number)
        box = tapped if isinstance(tapped, Box) else _around(*tapped, seen, self._place())
        operation = Tap(seen.frame.id, (box.left, box.top, box.right, box.bottom), *self.word)
        return Answer(number, Motion.NONE, (operation,))

    def happened(self, event: Event, turn: Turn) -> None:
        """Mark what an acknowledged tap has taught."""
        if isinstance(event, Reply):
            self._answered(event.answer, event.acknowledgement, turn.now)

    def see(self, turn: Turn) -> None:
        """Forget what was tapped once its call or hold is over."""
        self._forget(turn.now)

    def _answered(self, answer: Answer, ack: Acknowledgement, now: float) -> None:
        """Mark what a tap has taught. The next one is an obstacle again."""
        match answer.operations:
            case (Tap(box=sides),) if answer.via in COMMANDS and ack.result in CHANGING_RESULTS:
                box = Box(*sides)
                self._taps = (*(self._taps if ack.target == self._tapped else ()), box)[-4:]
                self._tapped, self._tapped_at = ack.target, now
                self._link.camera.mark(box)
                self._link.parameters.set_value(TAP_WORD, -1.0, now)

    def _forget(self, now: float) -> None:
        """Forget what was tapped, and the word for the next tap, once their call or hold is over."""
        if self._calls.current_id != self._current:
            if self._current:
                self._link.parameters.set_value(TAP_WORD, -1.0, now)
            self._current = self._calls.current_id
        if self._taps and self._calls.current_id != self._tapped:
            self._taps = ()
            self._link.camera.mark(None)

    def _place(self) -> Box | None:
        seen = self._seen()
        return place_of(self._calls.kind, seen) if seen is not None else None

    def _seen(self) -> Assessment | None:
        call, hold = self._calls.call, self._calls.hold
        if self._calls.kind is Kind.CALL:
            return call.seen if call is not None else None
        return hold.seen if hold is not None else None


def _around(x: float, y: float, seen: Assessment, place: Box | None) -> Box:
    """Return the place that is asked about where the point lies in it, else a square around the point."""
    if place is not None and place.contains(x, y):
        return place
    height, width = seen.frame.image.shape[:2] if seen.frame.image.size else (3, 4)
    high = HALF * width / height
    return Box(max(0.0, x - HALF), max(0.0, y - high), min(1.0, x + HALF), min(1.0, y + high))
