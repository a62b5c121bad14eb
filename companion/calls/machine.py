"""Decides about calls and holds, as one state machine. It does no I/O and reads no clock.

Inputs are `assessed` (a judged frame), `vehicle` (mode and arming), `answered` (an applied answer),
`policy_changed`, and `tick` for the passing of time. Each carries `now` (monotonic seconds), and returns the
decisions that it led to.
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
from companion.calls.hold_rules import HoldController, VehicleMode
from companion.calls.numbers import Numbers
from companion.calls.policy import PolicyState
from companion.calls.reason_filter import CALLS_FOR_WORDS, ReasonFilter
from companion.calls.shadow import Shadow
from companion.vehicle import Autopilot
from companion.wire.ids import Kind, Motion, Outcome, Policy, Result, Stage, State


class OperatorCalls:
    """Keeps at most one open call and one hold. Ids come from one counter; a call and its hold share one."""

    def __init__(self, numbers: Numbers, policy_state: PolicyState, now: float, last_id: int = 0) -> None:
        """policy_state: is asked for the policy in force. last_id: the newest id that was used."""
        self.numbers = numbers
        self._policy_state = policy_state
        self.last_id = last_id
        self.reason_filter = ReasonFilter(numbers, now)
        self.holding = HoldController(numbers)
        self.call: Call | None = None
        self._reasons: frozenset[Reason] = frozenset()
        self.shadow = Shadow()

    def assessed(self, seen: Assessment, now: float, *, memory_stored: bool = True) -> list[Decision]:
        """Take in a judged frame.

        memory_stored: the memory that it was judged with is in the journal, or the disk did not take it in
        time. If not, the frame may start a hold, but does not count towards its end.
        """
        self.reason_filter.take(seen, now, self.vehicle_mode.travelled, memory_stored=memory_stored)
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
        """Take in a report of the autopilot. A mode that we did not command was set by a human, who wins.

        heard_at: when the mode was reported, by default `now`; the same time again means no new report.
        travelled: metres driven, None where not known. autopilot: the table for its kind; without one the
        vehicle is never held.
        """
        told_at = now if heard_at is None else heard_at
        event = self.holding.hear(VehicleMode(mode, armed, travelled, told_at, autopilot), now)
        decisions: list[Decision] = []
        if event in (HoldEvent.CONFIRMED, HoldEvent.REBOOTED) and self.hold is not None:
            decisions.append(HoldMoved(self.hold, event))
        elif event is not None:
            decisions += self._end_hold(event, now)
        return decisions + self._settle(now)

    def tick(self, now: float) -> list[Decision]:
        """Let time pass."""
        return self._settle(now)

    def policy_changed(self, before: Policy, now: float) -> list[Decision]:
        """Follow a change of the policy in force, which was `before`.

        Without `hold` nothing is commanded any more, not even a resume. Only the release of our setpoints
        still is. After `off` it starts with nothing open or accepted.
        """
        policy = self.policy
        if policy is before:
            return []
        decisions: list[Decision] = [*self.shadow.leave(now)]
        if before is Policy.OFF:
            self.reason_filter.acceptance = None
        if policy is not Policy.HOLD:
            self.holding.leave(now)
            dropped = self.holding.end()
            if dropped is not None:
                decisions.append(HoldMoved(dropped, HoldEvent.DROPPED))
        if policy is Policy.OFF and self.call is not None:
            decisions.append(self._close(Outcome.SWITCHED_OFF))
        return decisions + self._settle(now)

    def require_go(self, *, anew: bool) -> None:
        """Require a go to end the current hold. anew: an earlier go is revoked."""
        if self.hold is not None:
            self.hold.only_fault = False
            if anew:
                self.holding.go_at = None

    def retune(self, judging: Settings) -> None:
        """Use other thresholds and another region of interest from now on."""
        self.numbers = replace(self.numbers, judging=judging)
        self.reason_filter.numbers = self.holding.numbers = self.numbers

    def resolve(self, target: int, now: float) -> int | None:
        """Return the id that an answer to `target` means (0: the current one), None where it is stale.

        An answer to 0 counts only where the current id was announced long enough ago to have been read.
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
        """Take in an applied answer to `target`, an id that `resolve` returned. Returns its result, too.

        changed: it taught words. outcome: the call's frame and the newest frame, judged again; None where
        neither was. go_at: when the answer was received. A go in it then has no effect before `confirm_go`.
        None: it counts at once.
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
                self.vehicle_mode.travelled,
                clear=clear,
            )
        if motion is Motion.LOOK_AGAIN:
            self.reason_filter.look_again()
        if outcome is not None and outcome.newest is not None:
            self.reason_filter.judge_again(outcome.newest, now)
        at = now if go_at is None else go_at
        self.holding.answer(motion if result is Result.APPLIED else Motion.NONE, at)
        if go_at is None:
            self.holding.confirm_go(at, self.reason_filter)
        return result, self._settle(now)

    def confirm_go(self, at: float, now: float) -> list[Decision]:
        """Let the go that was received at `at` count from now on, as the journal has it, or was too slow.

        A go that was revoked meanwhile does not count.
        """
        self.holding.confirm_go(at, self.reason_filter)
        return self._settle(now)

    @property
    def policy(self) -> Policy:
        """The policy in force."""
        return self._policy_state.in_force

    @property
    def hold(self) -> Hold | None:
        """The hold that is commanded or stands, None without one."""
        return self.holding.hold

    @property
    def vehicle_mode(self) -> VehicleMode:
        """The newest report of the autopilot."""
        return self.holding.vehicle

    @property
    def go_at(self) -> float | None:
        """When the go was given that the hold waits to fulfil, None without one."""
        return self.holding.go_at

    @property
    def current_id(self) -> int:
        """The id in the announcement: the open call's, else the hold's, else 0."""
        if self.call is not None:
            return self.call.id
        return self.hold.id if self.hold is not None else 0

    @property
    def kind(self) -> Kind:
        """Whether the current id names a call or a hold."""
        return Kind.CALL if self.call is not None else Kind.HOLD

    def take_id(self) -> int:
        """Take the next id of the counter, for something else than a call or a hold."""
        return self._next_id()

    def stage(self) -> Stage:
        """Return the stage of the current call or hold, CLOSED without one."""
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
        """Return the reasons to report now.

        A silent autopilot is a fault that is only reported: no mode can be commanded then.
        """
        return self.reason_filter.reasons(now) | (
            {Reason.FAULT} if self.autopilot_silent(now) else frozenset()
        )

    def autopilot_silent(self, now: float) -> bool:
        """Whether the policy is hold and the autopilot's heartbeats, which came before, have stopped."""
        return self.policy is Policy.HOLD and self.holding.silent(now)

    def state(self, now: float) -> State:
        """Return the state for the heartbeat: what a human should know first."""
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
            decisions += self._update_shadow(reasons, now)
        if self.policy is Policy.HOLD and reasons and self.hold is None and self.holding.drives_itself(now):
            number = self.call.id if self.call is not None else self._next_id()
            decisions.append(self.holding.start(number, reasons, now))
        return decisions + self.holding.settle(reasons, self.reason_filter, self.call is not None, now)

    def _settle_call(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        decisions: list[Decision] = []
        asking = reasons & CALLS_FOR_WORDS
        # With a hold, an answered call stays open until the go is fulfilled; new reasons need a new call.
        if self.call is not None and self.call.answered and (asking or self.hold is None):
            decisions.append(self._close(self.call.outcome_now))
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

    def _update_shadow(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        """Update the would-be hold.

        Without any autopilot it watches as if one drove, so that recorded pictures can be judged.
        """
        drives = self.holding.drives_itself(now)
        return self.shadow.look(
            reasons,
            now,
            watching=self.vehicle_mode.mode is None or drives,
            taken=self.holding.heard(now) and not drives,
            clear=self.reason_filter.ok_run >= self.numbers.ok_frames,
        )

    def _end_hold(self, event: HoldEvent, now: float) -> list[Decision]:
        """End the hold after a resume or a take-over. What a human drives past on their own is accepted."""
        hold, call = self.holding.end(), self.call
        assert hold is not None
        decisions: list[Decision] = [HoldMoved(hold, event)]
        if event is HoldEvent.TAKEN_OVER:
            accept_taken_over(call, self.reason_filter, now, self.vehicle_mode.travelled)
            if call is not None:
                decisions.append(self._close(Outcome.TAKEN_OVER))
        elif call is not None:
            decisions.append(self._close(call.outcome_now))
        return decisions

    def _open(self, reasons: frozenset[Reason], seen: Assessment, now: float) -> list[Decision]:
        scope = Acceptance.of(seen, reasons, self.numbers, now, self.vehicle_mode.travelled)
        self.call = Call(self._next_id(), seen.frame.id, set(reasons), now, seen, scope)
        self.call.add(seen)
        decisions: list[Decision] = [CallOpened(self.call)]
        if self.hold is not None:
            # A go for the hold alone did not know of this call: it must be given again.
            decisions.append(HoldRenamed(self.hold.id, self.hold))
            self.hold.id, self.holding.go_at = self.call.id, None
        return decisions

    def _close(self, outcome: Outcome) -> CallClosed:
        assert self.call is not None
        call, self.call = self.call, None
        call.outcome = outcome
        return CallClosed(call)

    def _next_id(self) -> int:
        # 16 bits on the wire; 0 means the current call or hold, so it is no id.
        self.last_id = self.last_id % 0xFFFF + 1
        return self.last_id
