"""Has vision keep the frames of the open call and the hold, to which answers and taps refer."""

from __future__ import annotations

import logging

from anytraverse.assessment import Assessment
from companion.calls.decisions import Call, HoldShown
from companion.calls.machine import OperatorCalls
from companion.daemon.persistence import Persistence
from companion.daemon.turn import CallShown, Event
from companion.storage import Journal, JournalError
from companion.vehicle.state import VehiclePosition
from companion.vision.client import VisionClient
from companion.vision.messages import Done, Drawn
from companion.wire.ids import State
from companion.wire.texts import REASONS

log = logging.getLogger(__name__)

_CALL_FRAME = object()


class CallFrames:
    """Keeps a frame from the moment its call opens or its hold is shown, before any answer can refer to it.

    One that vision lost is restored from the journal, or replaced by the next judged one.
    """

    def __init__(
        self,
        vision: VisionClient,
        calls: OperatorCalls,
        persistence: Persistence,
        position: VehiclePosition,
        events: list[Event],
    ) -> None:
        """events: takes a `CallShown` for each frame that is shown anew."""
        self._vision = vision
        self._calls = calls
        self._persistence = persistence
        self._position = position
        self._events = events
        self._lost = False
        self._kept: Assessment | None = None

    def call_opened(self, call: Call, now: float) -> None:
        """Have a new call's frame stored and drawn. The call gets the vehicle's place."""
        call.place = self._position.place()
        if call.seen is None:
            return
        reasons = ", ".join(sorted(REASONS[reason.value] for reason in call.reasons))
        self._keep(call.id, call.seen, self._calls.state(now), f"C{call.id} {reasons}", call)

    def hold_shown(self, shown: HoldShown, now: float) -> None:
        """Have the frame of a hold stored and drawn, if it still stands without a call."""
        if shown.hold is self._calls.hold and self._calls.call is None:
            number = shown.hold.id
            self._keep(number, shown.seen, self._calls.state(now), f"H{number} blocked")

    def answered(self, now: float) -> None:
        """Show the open call again after an answer by which its frame was judged again."""
        call = self._calls.call
        if call is None or call.seen is None:
            return
        title = f"C{call.id} " + ("answered" if call.answered else "still open")
        if call.seen is self._kept:
            self._events.append(CallShown(call.id, call.seen, call, title, None))
        else:
            self._keep(call.id, call.seen, self._calls.state(now), title, call)

    def drawn(self, drawn: Drawn) -> None:
        """Queue the open call's frame for the journal, once vision has stored it."""
        call = self._calls.call
        if drawn.stored and drawn.png and call is not None and call.frame_id == drawn.frame_id:
            self._persistence.save_frame(drawn.frame_id, drawn.png)

    def restore(self, journal: Journal) -> None:
        """Have the frame of a call that was open at the restart judged again, before the first turn."""
        call = self._calls.call
        if call is None:
            return
        try:
            png = journal.load_frame(call.frame_id)
        except JournalError as error:
            log.warning("the frame of call %d is lost: %s", call.id, error)
            png = None
        self._lost = png is None or not self._vision.restore(_CALL_FRAME, call.frame_id, png)

    def forget_lost(self) -> None:
        """Forget frames of the open call and the hold that vision has lost: answers cannot refer to them."""
        if self._vision.trouble:
            return
        holds = self._vision.has_stored_frame
        call, hold = self._calls.call, self._calls.hold
        if call is not None and call.seen is not None and not holds(call.frame_id):
            call.seen, self._lost = None, True
        if hold is not None and hold.seen is not None and not holds(hold.seen.frame.id):
            hold.seen = None

    @staticmethod
    def is_call_frame(token: object) -> bool:
        """Whether a `Done` is the outcome of a stored frame given to vision, and not of an answer."""
        return token is _CALL_FRAME or token is None

    def call_frame_judged(self, done: Done) -> None:
        """Take the assessment of the restored call's frame. Without one, the frame may be lost."""
        call, seen = self._calls.call, done.outcome.call if done.outcome is not None else None
        if call is None:
            return
        if seen is None:
            self._lost = not self._vision.has_stored_frame(call.frame_id)
        elif seen.frame.id == call.frame_id:
            self._resume_call(call, seen)

    def replace_lost(self, seen: Assessment) -> None:
        """Make `seen` the frame of the open call, if the call's own frame is lost."""
        call = self._calls.call
        lost = self._lost and call is not None and call.seen is None
        if not lost or self._vision.trouble or call is None or seen.observation is None:
            return
        self._lost = False
        call.frame_id = seen.frame.id
        self._resume_call(call, seen, replaced=True)

    def _resume_call(self, call: Call, seen: Assessment, *, replaced: bool = False) -> None:
        if call.seen is not None:
            return
        call.thing, call.seen = self._calls.reason_filter.things.asked(seen, frozenset(call.reasons))
        call.thing.call = call.id
        self._keep(call.id, seen, State.CALLING, f"C{call.id} after a restart", call, replaced=replaced)

    def _keep(
        self,
        number: int,
        seen: Assessment,
        state: State,
        title: str,
        call: Call | None = None,
        *,
        replaced: bool = False,
    ) -> None:
        accepted = self._vision.draw(seen.frame.id, title, state, store=True, roi=seen.roi)
        self._kept = seen
        drawing = self._vision.newest_request if accepted else 0
        self._events.append(CallShown(number, seen, call, title, drawing, replaced))
