"""Debounces the reasons of the frames, leaves out accepted ones, and makes it a fault when no OK frame came.

Pure: time is an input.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterator

from anytraverse.assessment import Assessment, Reason
from companion.calls.answered_things import AnsweredThings
from companion.calls.cover import Cover
from companion.calls.faults import Fault, Faults
from companion.calls.numbers import Numbers
from companion.calls.thing import Thing


class Debounce:
    """Debounces one reason.

    It starts after `needed` bad frames of the last `window`, and ends after as many clear ones.
    """

    def __init__(self, needed: int, window: int) -> None:
        self._needed = needed
        self._bad: deque[bool] = deque(maxlen=window)
        self._clear: deque[bool] = deque(maxlen=window)
        self.active = False

    def add(self, *, bad: bool, clear: bool) -> None:
        """Add a frame. One that is neither bad nor clear counts for neither."""
        self._bad.append(bad)
        self._clear.append(clear)
        if self._bad.count(True) >= self._needed:
            self.active = True
        elif self._clear.count(True) >= self._needed:
            self.active = False

    def amend(self, *, bad: bool, clear: bool) -> None:
        """Replace the newest frame, which was judged again."""
        if self._bad:
            self._bad.pop()
            self._clear.pop()
        self.add(bad=bad, clear=clear)

    def reset(self) -> None:
        """Forget all frames, and become inactive."""
        self._bad.clear()
        self._clear.clear()
        self.active = False


CALLS_FOR_WORDS = frozenset({Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT})
PASSABLE = frozenset({Reason.UNKNOWN_OBJECT, Reason.BLOCKED})
"""Reasons of something in the region of interest, which may have room beside it."""


_ROUND_LASTS = 3.0
"""s for which it counts that something was driven round: longer than an operator reads and a text travels."""


class ReasonFilter:
    """Decides which reasons count now. It fails closed.

    Without a fresh frame there is a fault. Without an OK frame within T there is a reason even before the
    debouncing of one is over. A frame's age counts from its capture: a frame that is older than T is not OK
    and ends no reason.

    things: what was answered about, and is not gone. ok_run: OK frames in a row.
    passes: what stands in the region is driven round, so that it is no reason. no_way: why the vehicle cannot
    go on round it, whatever the region shows; "" where it can.
    not_ok_at: when it was last not OK: because of a frame, because none came, or because of another fault.
    faults: the faults that stand, of the view and of the rest, and what a human accepted of them.
    """

    def __init__(self, numbers: Numbers, now: float) -> None:
        self.numbers = numbers
        self.newest: Assessment | None = None
        self.things = AnsweredThings(numbers)
        self.faults = Faults(numbers)
        self.ok_run = 0
        self.passes, self.no_way = False, ""
        self.was_ok = False
        """Whether any frame was OK yet. Before that the state is not OK, although no reason counts yet."""
        self.not_ok_at = now
        self._round_at = -math.inf
        self._ok_at = self._seen_at = now
        """Capture times of the newest OK frame, and of the newest frame."""
        self._ok = False
        self._debounced = {reason: Debounce(numbers.votes, numbers.window) for reason in Reason}
        self._only_named: frozenset[Reason] = frozenset()
        """Reasons of things that block where the newest frame does not show it."""
        self._not_accepted: frozenset[Reason] = frozenset()
        """Reasons of the newest frame that no answer accepted, and reasons of things that block the way."""

    def add_frame(
        self, seen: Assessment, now: float, travelled: float | None, *, memory_stored: bool = True
    ) -> None:
        """Take in a newly judged frame.

        travelled: metres driven, None where not known.
        memory_stored: whether an OK frame may add to `ok_run`.
        """
        self.tick(now)
        self._seen_at = max(self._seen_at, _captured(seen, now))
        cover = self._judge_newest(seen, now)
        self.things.follow(seen, cover, now, travelled)
        for debounce, bad, clear in self._votes(seen, now):
            debounce.add(bad=bad, clear=clear)
        if self._ok:
            self.ok_run += memory_stored

    def replace_newest(self, seen: Assessment, now: float) -> None:
        """Take in the newest frame, judged again. It replaces its earlier judgement."""
        self._judge_newest(seen, now)
        for debounce, bad, clear in self._votes(seen, now):
            debounce.amend(bad=bad, clear=clear)

    def tick(self, now: float) -> None:
        """Update the faults of view and region.

        Without a fresh frame, or in another fault, end the run of OK frames.
        """
        self.faults.report(Fault.VIEW, now, stands=Reason.FAULT in self._reasons_of_view(now))
        misfit = bool(self.numbers.judging.misfit)
        self.faults.report(Fault.REGION, now, stands=misfit, what="ROI does not fit" if misfit else "")
        if self.passes and self.shows_passable:
            self._round_at = now
        if not self.fresh(now) or self.faults.standing - {Fault.VIEW} or self.no_way:
            self.not_ok_at, self.ok_run = now, 0

    def reasons(self, now: float) -> frozenset[Reason]:
        """Return the reasons that count now. A fault that a human accepted does not."""
        reasons = self._reasons_of_view(now) - {Reason.FAULT}
        return reasons | {Reason.FAULT} if self.standing_faults(now) - self.faults.accepted else reasons

    def standing_faults(self, now: float) -> frozenset[Fault]:
        """Return the faults that stand now, accepted or not."""
        of_view = Reason.FAULT in self._reasons_of_view(now)
        return self.faults.standing - {Fault.VIEW} | ({Fault.VIEW} if of_view else frozenset())

    def _reasons_of_view(self, now: float) -> frozenset[Reason]:
        active = {reason for reason, debounce in self._debounced.items() if debounce.active} - self._passed
        if not self.fresh(now):
            active.add(Reason.FAULT)
        if not active and now - self._ok_at > self.numbers.freshness:
            # Frames come, but none is OK: what the newest one shows counts now, debounced or not.
            active |= (self._not_accepted - self._passed) or {Reason.FAULT}
        return frozenset(active | {Reason.BLOCKED} if self.no_way else active)

    @property
    def _passed(self) -> frozenset[Reason]:
        """Reasons that are none now, since what causes them is driven round.

        A thing that blocks where the frame does not show that it does is no such cause: no plan knows of it.
        """
        if not self.passes:
            return frozenset()
        return PASSABLE - self._only_named

    @property
    def shows_passable(self) -> bool:
        """Whether something stands in the region that stops the vehicle, unless it is driven round."""
        return any(self._debounced[reason].active for reason in PASSABLE)

    def goes_round(self, now: float) -> bool:
        """Whether something stands in the region that the vehicle drives round, or will once it may.

        It lasts: a go that was given to the text of it must not mean something else as it arrives.
        """
        return now - self._round_at <= _ROUND_LASTS

    def fresh(self, now: float) -> bool:
        """Whether a frame that was captured within T has been judged."""
        return now - self._seen_at <= self.numbers.freshness

    def reset_reasons(self) -> None:
        """Restart the debouncing of all reasons but the fault, which only clear frames end."""
        for reason in Reason:
            if reason is not Reason.FAULT:
                self._debounced[reason].reset()

    def restart_after_answer(self, now: float) -> None:
        """Restart the debouncing of calls, and T, after an answer: it changed what earlier frames say."""
        for reason in CALLS_FOR_WORDS:
            self._debounced[reason].reset()
        self._not_accepted = frozenset()
        self._ok_at = now

    def accept(self, thing: Thing, reasons: Collection[Reason], now: float, travelled: float | None) -> None:
        """Accept `reasons` of a thing."""
        self.things.accept(thing, reasons, now, travelled)
        for reason in reasons:
            self._debounced[reason].reset()

    def restart_ok_run(self) -> None:
        """Count OK frames from now on."""
        self.ok_run = 0

    def _judge_newest(self, seen: Assessment, now: float) -> Cover:
        """Decide whether the frame is OK. Return what the things explain in it."""
        cover = self.things.cover(seen)
        self.newest = seen
        named = self.things.block(seen)
        self._only_named = named - seen.reasons
        self._not_accepted = seen.reasons - cover.covered | named
        stops = self._not_accepted - self._passed
        self._ok = bool(seen.findings) and not stops and not self._is_old(seen, now)
        self.was_ok = self.was_ok or self._ok
        if self._ok:
            self._ok_at = max(self._ok_at, _captured(seen, now))
        else:
            self.not_ok_at, self.ok_run = now, 0
        return cover

    def _is_old(self, seen: Assessment, now: float) -> bool:
        return now - seen.frame.captured_at > self.numbers.freshness

    def _votes(self, seen: Assessment, now: float) -> Iterator[tuple[Debounce, bool, bool]]:
        """Yield for each reason its debounce, whether the frame is bad, and whether it is clear.

        A changed scene that may still prove to be a remembered one is neither, within T of the last OK frame.
        """
        shown, fresh = seen.reasons, not self._is_old(seen, now)
        for reason, debounce in self._debounced.items():
            if reason in self._not_accepted:
                may_wait = reason is Reason.UNKNOWN_SCENE and seen.undecided
                waiting = may_wait and now - self._ok_at <= self.numbers.freshness
                yield debounce, not waiting, False
            else:
                yield debounce, False, fresh and (reason in shown or seen.is_clear(reason))


def _captured(seen: Assessment, now: float) -> float:
    """Return the frame's capture time, at most `now`.

    A later one is a camera's error. It must not make the silence after it look fresh.
    """
    return min(seen.frame.captured_at, now)
