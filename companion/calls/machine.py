"""The operator-call state machine. No I/O, no clock: every input carries `now` (monotonic seconds).

Inputs: `assessed` (a judged frame), `vehicle` (mode and arming), `answered` (an applied answer), `set_policy`
and `tick` for the passing of time. Each returns the decisions that it led to.
"""

from __future__ import annotations

from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Reason
from anytraverse.judging import Settings
from companion.calls.acceptance import Acceptance
from companion.calls.answer_rules import accept_taken_over, answer_call
from companion.calls.decisions import (
    Call,
    CallClosed,
    CallOpened,
    Decision,
    HoldMoved,
    HoldRenamed,
)
from companion.calls.hold import Hold, HoldEvent
from companion.calls.hold_rules import HoldController, Vehicle
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import CALLS_FOR_WORDS, ReasonFilter
from companion.calls.shadow import Shadow
from companion.vehicle import Autopilot
from companion.wire.ids import Kind, Motion, Outcome, Policy, Result, Stage, State


class OperatorCalls:
    """At most one call and one hold at a time; both draw their ids from one counter, and share one."""

    def __init__(self, numbers: Numbers, now: float, last_id: int = 0) -> None:
        self.numbers = numbers
        self.policy = numbers.policy
        self.last_id = last_id
        self.reason_filter = ReasonFilter(numbers, now)
        self.holding = HoldController(numbers)
        self.call: Call | None = None
        self._reasons: frozenset[Reason] = frozenset()
        self.shadow = Shadow()

    def assessed(self, seen: Assessment, now: float, *, settled: bool = True) -> list[Decision]:
        """A frame was judged. settled: under a memory that is kept; else it may hold, not let drive on."""
        self.reason_filter.take(seen, now, self.autopilot.travelled, settled=settled)
        if self.call is not None:
            self.call.add(seen)
            if self.call.scope is not None:
                self.call.scope.watch(seen, self.numbers)
        return self._settle(now)

    def vehicle(
        self,
        mode: int,
        armed: bool,
        now: float,
        travelled: float | None = None,
        heard_at: float | None = None,
        autopilot: Autopilot | None = None,
    ) -> list[Decision]:
        """The autopilot showed its mode. A mode that is not ours is a human's, who wins.

        heard_at: when it told the mode, `now` where not given; the same again is no news of the mode.
        autopilot: the table for its kind; without one it is never held.
        """
        told_at = now if heard_at is None else heard_at
        event = self.holding.hear(Vehicle(mode, armed, travelled, told_at, autopilot), now)
        decisions: list[Decision] = []
        if event in (HoldEvent.CONFIRMED, HoldEvent.REBOOTED) and self.hold is not None:
            decisions.append(HoldMoved(self.hold, event))
        elif event is not None:
            decisions += self._end_hold(event, now)
        return decisions + self._settle(now)

    def tick(self, now: float) -> list[Decision]:
        """Time passed."""
        return self._settle(now)

    def set_policy(self, policy: Policy, now: float) -> list[Decision]:
        """Report, shadow, hold or off. Without `hold` nothing is commanded any more, nor is the way back.

        Switched on again it begins with nothing open and nothing accepted.
        """
        if policy is self.policy:
            return []
        decisions: list[Decision] = [*self.shadow.leave(now)]
        if self.policy is Policy.OFF:
            self.reason_filter.acceptance = None
        self.policy = policy
        if policy is not Policy.HOLD:
            self.holding.leave(now)
            dropped = self.holding.end()
            if dropped is not None:
                decisions.append(HoldMoved(dropped, HoldEvent.DROPPED))
        if policy is Policy.OFF and self.call is not None:
            decisions.append(self._close(Outcome.SWITCHED_OFF))
        return decisions + self._settle(now)

    def require_go(self, *, anew: bool) -> None:
        """The hold that stands does not end without a go. anew: one that was given before is void."""
        if self.hold is not None:
            self.hold.only_fault = False
            if anew:
                self.holding.go_at = None

    def retune(self, judging: Settings) -> None:
        """Other thresholds from now on."""
        self.numbers = replace(self.numbers, judging=judging)
        self.reason_filter.numbers = self.holding.numbers = self.numbers

    def resolve(self, target: int, now: float) -> int | None:
        """The id that an answer to `target` means (0: the current one), or None when it is stale.

        The current one counts only when it was announced long enough ago to have been read.
        """
        current = self.current_id
        if current == 0 or target not in (0, current):
            return None
        read = now - self._announced_at() >= self.numbers.announce_guard
        return current if target == current or read else None

    def answered(
        self,
        target: int,
        motion: Motion,
        changed: bool,
        outcome: AnswerOutcome | None,
        now: float,
        *,
        go_at: float | None = None,
    ) -> tuple[Result, list[Decision]]:
        """An answer to `target` (an id that `resolve` gave) was applied.

        changed: it taught words. outcome: the call's and the newest frame judged again, where they were.
        go_at: when it was heard; a go of it then moves nothing before `go_kept`. None: it counts at once.
        """
        if target == 0 or target != self.current_id:
            return Result.STALE, []
        result, clear = Result.APPLIED, self.stage() is Stage.CLEAR
        if self.call is not None:
            result = answer_call(
                self.call,
                self.reason_filter,
                motion,
                changed,
                outcome,
                now,
                self.autopilot.travelled,
                clear=clear,
            )
        if motion is Motion.LOOK_AGAIN:
            self.reason_filter.look_again()
        if outcome is not None and outcome.newest is not None:
            self.reason_filter.judge_again(outcome.newest, now)
        at = now if go_at is None else go_at
        self.holding.answer(motion if result is Result.APPLIED else Motion.NONE, at)
        if go_at is None:
            self.holding.go_kept(at, self.reason_filter)
        return result, self._settle(now)

    def go_kept(self, at: float, now: float) -> list[Decision]:
        """The go that was heard at `at` is kept: it counts from now on, where nothing took it back."""
        self.holding.go_kept(at, self.reason_filter)
        return self._settle(now)

    @property
    def hold(self) -> Hold | None:
        """Our hold, if the vehicle is held or to be held."""
        return self.holding.hold

    @property
    def autopilot(self) -> Vehicle:
        """The newest that the autopilot said."""
        return self.holding.vehicle

    @property
    def go_at(self) -> float | None:
        """When the go was given that the hold waits to fulfil."""
        return self.holding.go_at

    @property
    def current_id(self) -> int:
        """The id that is announced: the open call's, else the hold's, else 0."""
        if self.call is not None:
            return self.call.id
        return self.hold.id if self.hold is not None else 0

    @property
    def kind(self) -> Kind:
        """What the current id names."""
        return Kind.CALL if self.call is not None else Kind.HOLD

    def take_id(self) -> int:
        """An id of the one counter for what is no call and no hold."""
        return self._next_id()

    def stage(self) -> Stage:
        """Where the current call or hold stands; CLOSED when there is none."""
        if self.current_id == 0:
            return Stage.CLOSED
        answered = self.call is not None and self.call.answered
        if self.call is not None and not answered and self.call.gone_since is None:
            return Stage.OPEN
        if self.go_at is not None:
            return Stage.ANSWERED
        if (
            self.hold is not None
            and not self._reasons
            and self.reason_filter.ok_run >= self.numbers.ok_frames
        ):
            return Stage.CLEAR
        return Stage.ANSWERED if answered else Stage.OPEN

    def reasons(self, now: float) -> frozenset[Reason]:
        """What is told to be wrong now. A silent autopilot is only told: nothing is commanded over it."""
        return self.reason_filter.reasons(now) | (
            {Reason.FAULT} if self.autopilot_silent(now) else frozenset()
        )

    def autopilot_silent(self, now: float) -> bool:
        """Whether the rover is to be held, and its autopilot, heard once, is silent."""
        return self.policy is Policy.HOLD and self.holding.silent(now)

    def state(self, now: float) -> State:
        """The one word of the heartbeat: what a human should know first."""
        if self.policy is Policy.OFF:
            return State.OFF
        reasons = self.reasons(now)
        if Reason.FAULT in reasons:
            return State.FAULT
        if self.call is not None and not self.call.answered:
            return State.CALLING
        if Reason.BLOCKED in reasons:
            return State.BLOCKED
        if self.hold is not None or reasons or self.holding.script_holds is not None:
            return State.HOLDING
        return State.OK if self.reason_filter.was_ok else State.STARTING

    def _announced_at(self) -> float:
        if self.call is not None:
            return self.call.opened_at
        return self.hold.started_at if self.hold is not None else 0.0

    def _settle(self, now: float) -> list[Decision]:
        self.reason_filter.pass_time(now)
        self._reasons = reasons = self.reason_filter.reasons(now)
        handed_over = self.holding.hand_over(now)
        if self.policy is Policy.OFF:
            return handed_over
        decisions = handed_over + self._settle_call(reasons, now)
        if self.policy is Policy.SHADOW:
            decisions += self._look_in_the_shadow(reasons, now)
        if self.policy is Policy.HOLD and reasons and self.hold is None and self.holding.drives_itself(now):
            number = self.call.id if self.call is not None else self._next_id()
            decisions.append(self.holding.start(number, reasons, now))
        return decisions + self.holding.settle(reasons, self.reason_filter, self.call is not None, now)

    def _settle_call(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        decisions: list[Decision] = []
        asking = reasons & CALLS_FOR_WORDS
        if self.call is not None and self.call.answered and (asking or self.hold is None):
            decisions.append(self._close(self.call.answered_outcome))
        if self.call is None and asking and self.reason_filter.newest is not None:
            decisions += self._open(asking, self.reason_filter.newest, now)
        call = self.call
        if call is None or call.answered:
            return decisions
        call.reasons |= asking
        if asking or Reason.FAULT in reasons or self.reason_filter.newest is None:
            call.gone_since = None
        elif call.gone_since is None:
            call.gone_since = now
        elif self.hold is None and now - call.gone_since >= self.numbers.passed_after:
            decisions.append(self._close(Outcome.PASSED))
        return decisions

    def _look_in_the_shadow(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        """Without any autopilot it is watched as if one drove: so pictures of a drive can be judged."""
        drives = self.holding.drives_itself(now)
        return self.shadow.look(
            reasons,
            now,
            watching=self.autopilot.mode is None or drives,
            taken=self.holding.heard(now) and not drives,
            clear=self.reason_filter.ok_run >= self.numbers.ok_frames,
        )

    def _end_hold(self, event: HoldEvent, now: float) -> list[Decision]:
        """A hold is over: resumed by us, or taken over by a human, whose judgement is accepted."""
        hold, call = self.holding.end(), self.call
        assert hold is not None
        decisions: list[Decision] = [HoldMoved(hold, event)]
        if event is HoldEvent.TAKEN_OVER:
            accept_taken_over(call, self.reason_filter, now, self.autopilot.travelled)
            if call is not None:
                decisions.append(self._close(Outcome.TAKEN_OVER))
        elif call is not None:
            decisions.append(self._close(call.answered_outcome if call.answered else Outcome.PASSED))
        return decisions

    def _open(self, reasons: frozenset[Reason], seen: Assessment, now: float) -> list[Decision]:
        scope = Acceptance.of(seen, reasons, self.numbers, now, self.autopilot.travelled)
        self.call = Call(self._next_id(), seen.frame.id, set(reasons), now, seen, scope)
        self.call.add(seen)
        decisions: list[Decision] = [CallOpened(self.call)]
        if self.hold is not None:
            decisions.append(HoldRenamed(self.hold.id, self.hold))
            self.hold.id, self.holding.go_at = self.call.id, None
        return decisions

    def _close(self, outcome: Outcome) -> CallClosed:
        assert self.call is not None
        call, self.call = self.call, None
        call.outcome = outcome
        return CallClosed(call)

    def _next_id(self) -> int:
        self.last_id = self.last_id % 0xFFFF + 1
        return self.last_id
