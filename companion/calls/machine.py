"""The operator-call state machine. No I/O, no clock: every input carries `now` (monotonic seconds).

Inputs: `assessed` (a judged frame), `vehicle` (mode and arming), `answered` (an applied answer), `set_policy`
and `tick` for the passing of time. Each returns the decisions that it led to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Reason
from anytraverse.judging import Settings
from companion.calls.acceptance import Acceptance
from companion.calls.decisions import (
    Call,
    CallClosed,
    CallOpened,
    Decision,
    GoLapsed,
    HoldMoved,
    HoldRenamed,
    HoldStarted,
    SetMode,
    WouldHold,
)
from companion.calls.hold import Hold, HoldEvent, HoldStage
from companion.calls.numbers import Numbers
from companion.calls.sight import CALLS_FOR_WORDS, Sight
from companion.wire.ids import Kind, Motion, Outcome, Policy, Result, Stage, State


@dataclass
class Vehicle:
    """The newest that the autopilot said. mode None: nothing yet. travelled: metres, None where not known."""

    mode: int | None = None
    armed: bool = False
    travelled: float | None = None


class OperatorCalls:
    """At most one call and one hold at a time; both draw their ids from one counter."""

    def __init__(self, numbers: Numbers, now: float, last_id: int = 0) -> None:
        self.numbers = numbers
        self.policy = numbers.policy
        self.last_id = last_id
        self.sight = Sight(numbers, now)
        self.call: Call | None = None
        self.hold: Hold | None = None
        self.autopilot = Vehicle()
        self.go_at: float | None = None
        self._would_hold = False

    def assessed(self, seen: Assessment, now: float) -> list[Decision]:
        """A frame was judged."""
        self.sight.take(seen, now, self.autopilot.travelled)
        if self.call is not None and self.call.scope is not None:
            self.call.scope.follow(seen, self.numbers)
            self.call.scope.witness(seen)
        return self._settle(now)

    def vehicle(self, mode: int, armed: bool, now: float, travelled: float | None = None) -> list[Decision]:
        """The autopilot showed its mode. A mode that is not ours is a human's, who wins."""
        self.autopilot = Vehicle(mode, armed, travelled)
        decisions: list[Decision] = []
        if self.hold is not None:
            event = self.hold.vehicle(mode, self.numbers)
            if event is HoldEvent.CONFIRMED:
                decisions.append(HoldMoved(self.hold, event))
            elif event is not None:
                decisions += self._end_hold(event, now)
        return decisions + self._settle(now)

    def tick(self, now: float) -> list[Decision]:
        """Time passed."""
        return self._settle(now)

    def set_policy(self, policy: Policy, now: float) -> list[Decision]:
        """Report, shadow, hold or off. Without `hold` nothing is commanded any more, nor is the way back."""
        self.policy, self._would_hold = policy, False
        decisions: list[Decision] = []
        if policy is not Policy.HOLD and self.hold is not None:
            decisions.append(HoldMoved(self.hold, HoldEvent.DROPPED))
            self.hold, self.go_at = None, None
        if policy is Policy.OFF and self.call is not None:
            decisions.append(self._close(Outcome.SWITCHED_OFF))
        return decisions + self._settle(now)

    def retune(self, judging: Settings) -> None:
        """Other thresholds from now on."""
        self.numbers = self.sight.numbers = replace(self.numbers, judging=judging)

    def resolve(self, target: int, now: float) -> int | None:
        """The id that an answer to `target` means (0: the current one), or None when it is stale.

        The current one counts only when it was announced long enough ago to have been read.
        """
        announced: dict[int, float] = {}
        if self.hold is not None:
            announced[self.hold.id] = self.hold.started_at
        if self.call is not None:
            announced[self.call.id] = self.call.opened_at
        if target == 0 and self.current_id:
            read = now - announced[self.current_id] >= self.numbers.announce_guard
            return self.current_id if read else None
        return target if target in announced else None

    def answered(
        self, target: int, motion: Motion, changed: bool, outcome: AnswerOutcome | None, now: float
    ) -> tuple[Result, list[Decision]]:
        """An answer to `target` (an id that `resolve` gave) was applied.

        changed: it taught words. outcome: the call's and the newest frame judged again, where they were.
        """
        if target not in (self.current_id, self.hold.id if self.hold else self.current_id) or target == 0:
            return Result.STALE, []
        result = Result.APPLIED
        call = self.call if self.call is not None and self.call.id == target else None
        if call is not None:
            result = self._answer_call(call, motion, changed, outcome, now)
        if outcome is not None and outcome.newest is not None:
            self.sight.take(outcome.newest, now, self.autopilot.travelled)
        if motion is Motion.GO:
            self.go_at, self.sight.ok_run = now, 0
        elif motion is Motion.STAY:
            self.go_at = None
        decisions: list[Decision] = []
        if call is not None and call.answered and self.hold is None:
            decisions.append(self._close(call.answered_outcome))
        return result, decisions + self._settle(now)

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

    def stage(self) -> Stage:
        """Where the current call or hold stands; CLOSED when there is none."""
        if self.call is None and self.hold is None:
            return Stage.CLOSED
        if self.call is not None and not self.call.answered and self.call.gone_since is None:
            return Stage.OPEN
        if self.go_at is not None:
            return Stage.ANSWERED
        if self.hold is not None and self.sight.ok_run >= self.numbers.ok_frames:
            return Stage.CLEAR
        return Stage.ANSWERED if self.call is not None and self.call.answered else Stage.OPEN

    def state(self, now: float) -> State:
        """The one word of the heartbeat."""
        if self.policy is Policy.OFF:
            return State.OFF
        reasons = self.sight.reasons(now)
        if Reason.FAULT in reasons:
            return State.FAULT
        if self.sight.newest is None:
            return State.STARTING
        if self.call is not None and not self.call.answered:
            return State.CALLING
        if Reason.BLOCKED in reasons:
            return State.BLOCKED
        return State.HOLDING if self.hold is not None or reasons else State.OK

    def _answer_call(
        self, call: Call, motion: Motion, changed: bool, outcome: AnswerOutcome | None, now: float
    ) -> Result:
        if motion is Motion.STAY:
            call.quiet = True
        if changed and outcome is not None:
            call.seen = outcome.call
            if self._left(call, outcome):
                call.tried = True
                return Result.NOT_COVERED
            call.answered = True
            self.sight.look_afresh(now)
        elif motion is Motion.GO:
            call.answered = call.accepted = True
            self.sight.accept(call.reasons, call.scope, now, self.autopilot.travelled)
            self.sight.look_afresh(now)
        elif motion is Motion.LOOK_AGAIN:
            self.sight.look_afresh(now)
        return Result.APPLIED

    def _settle(self, now: float) -> list[Decision]:
        if self.policy is Policy.OFF:
            return []
        reasons = self.sight.reasons(now)
        return [
            *self._settle_call(reasons & CALLS_FOR_WORDS, now),
            *self._settle_shadow(reasons),
            *self._settle_hold(reasons, now),
        ]

    def _settle_call(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        decisions: list[Decision] = []
        if self.call is not None and self.call.answered and reasons:
            decisions.append(self._close(self.call.answered_outcome))
        if self.call is None and reasons and self.sight.newest is not None:
            decisions += self._open(reasons, self.sight.newest, now)
        call = self.call
        if call is None or call.answered:
            return decisions
        call.reasons |= reasons
        if reasons or not self.sight.fresh(now):
            call.gone_since = None
        elif call.gone_since is None:
            call.gone_since = now
        elif self.hold is None and now - call.gone_since >= self.numbers.passed_after:
            decisions.append(self._close(Outcome.PASSED))
        return decisions

    def _settle_shadow(self, reasons: frozenset[Reason]) -> list[Decision]:
        if self.policy is not Policy.SHADOW:
            return []
        if self._would_hold:
            self._would_hold = bool(reasons) or self.sight.ok_run < self.numbers.ok_frames
        elif reasons and (self.autopilot.mode is None or self._drives_itself()):
            self._would_hold = True
            return [WouldHold(reasons)]
        return []

    def _settle_hold(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        decisions: list[Decision] = []
        if reasons and self.policy is Policy.HOLD:
            decisions += self._demand_hold(reasons, now)
        if self.hold is None:
            return decisions
        self.hold.only_fault = self.hold.only_fault and reasons <= {Reason.FAULT}
        if self.go_at is not None and self.sight.bad_at - self.go_at > self.numbers.go_lasts:
            self.go_at = None
            decisions.append(GoLapsed(self.hold.id))
        if not reasons and self._may_resume(self.hold):
            self.hold.turn(HoldStage.RESUMING)
        resuming = self.hold.stage is HoldStage.RESUMING
        mode, event = self.hold.tick(now, self.numbers)
        if event is not None:
            decisions.append(HoldMoved(self.hold, event, resuming))
            self.go_at = None if resuming else self.go_at
        if mode is not None:
            decisions.append(SetMode(mode))
        return decisions

    def _demand_hold(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        """Only in the autopilot's own driving modes, only when armed; a resume under way is called back."""
        if self.hold is not None:
            if self.hold.stage is HoldStage.RESUMING:
                self.hold.turn(HoldStage.REQUESTED)
            return []
        if not self._drives_itself() or self.autopilot.mode is None:
            return []
        self.hold = Hold(self.call.id if self.call else self._next_id(), self.autopilot.mode, now)
        return [HoldStarted(self.hold, reasons)]

    def _drives_itself(self) -> bool:
        return self.autopilot.armed and self.autopilot.mode in self.numbers.holdable

    def _may_resume(self, hold: Hold) -> bool:
        if hold.stage is not HoldStage.STANDING or not self.autopilot.armed:
            return False
        if self.sight.ok_run < self.numbers.ok_frames:
            return False
        return self.go_at is not None or (self.numbers.fault_ends_hold and hold.only_fault)

    def _end_hold(self, event: HoldEvent, now: float) -> list[Decision]:
        """A hold is over: resumed by us, or taken over by a human, whose judgement is accepted."""
        assert self.hold is not None
        decisions: list[Decision] = [HoldMoved(self.hold, event)]
        self.hold, self.go_at = None, None
        call = self.call
        if event is HoldEvent.TAKEN_OVER:
            asked = call.reasons if call is not None and not call.answered else set[Reason]()
            reasons = (self.sight.reasons(now) | asked) - {Reason.FAULT}
            self.sight.accept(reasons, call.scope if call else None, now, self.autopilot.travelled)
            self.sight.look_afresh(now)
            if call is not None:
                decisions.append(self._close(Outcome.TAKEN_OVER))
        elif call is not None:
            decisions.append(self._close(call.answered_outcome if call.answered else Outcome.PASSED))
        return decisions

    def _open(self, reasons: frozenset[Reason], seen: Assessment, now: float) -> list[Decision]:
        scope = Acceptance.of(seen, reasons, self.numbers, now, self.autopilot.travelled)
        self.call = Call(self._next_id(), seen.frame.id, set(reasons), now, seen, scope)
        self.go_at = None
        decisions: list[Decision] = [CallOpened(self.call)]
        if self.hold is not None:
            decisions.append(HoldRenamed(self.hold.id, self.hold))
            self.hold.id = self.call.id
        return decisions

    def _close(self, outcome: Outcome) -> CallClosed:
        assert self.call is not None
        call, self.call = self.call, None
        call.outcome = outcome
        return CallClosed(call)

    def _left(self, call: Call, outcome: AnswerOutcome) -> frozenset[Reason]:
        """The call's reasons that its frame, judged again, still has. What was not judged is not covered."""
        if outcome.call is None or outcome.call.roi is None:
            return frozenset(call.reasons)
        return outcome.call.reasons & call.reasons

    def _next_id(self) -> int:
        self.last_id = self.last_id % 0xFFFF + 1
        return self.last_id
