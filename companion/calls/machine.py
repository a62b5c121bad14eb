"""Decides about calls and holds, as one state machine. It does no I/O and reads no clock.

Inputs are `assessed` (a judged frame), `vehicle_reported` (mode and arming), `apply_answer`, `confirm_go`,
`policy_changed`, and `tick` for the passing of time. Each carries `now` (monotonic seconds), and returns the
decisions that it led to. An exception in one of them may leave it half changed: it raises FatalError, and
must not be used any more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from anytraverse.answers import AnswerOutcome
from anytraverse.assessment import Assessment, Reason
from anytraverse.judging import Settings
from anytraverse.operations import Operation
from companion.calls.call_rules import CallController, accept_taken_over, answer_call
from companion.calls.decisions import Call, Decision, FaultAcceptanceEnds, FaultAccepted, HoldMoved, Unasked
from companion.calls.faults import TOLD_FOR, Fault
from companion.calls.hold import Hold, HoldEvent
from companion.calls.hold_rules import HoldController
from companion.calls.mode_monitor import ModeAnswer, ModeMonitor, ModeReport
from companion.calls.numbers import Numbers
from companion.calls.policy import PolicyState, Shadow
from companion.calls.reason_filter import ReasonFilter
from companion.system.error_guard import FatalError
from companion.wire.ids import Kind, Motion, Outcome, Policy, Result, Stage, State


@contextmanager
def _transition() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        raise FatalError(f"the state machine of calls and holds failed: {error!r}") from error


class OperatorCalls:
    """Keeps at most one open call and one hold. Ids come from one counter; a call and its hold share one."""

    def __init__(self, numbers: Numbers, policy_state: PolicyState, now: float, last_id: int = 0) -> None:
        """policy_state: is asked for the policy in force. last_id: the newest id that was used."""
        self.numbers = numbers
        self._policy_state = policy_state
        self.last_id = last_id
        self.reason_filter = ReasonFilter(numbers, now)
        self.monitor = ModeMonitor(numbers)
        self.holding = HoldController(numbers, self.monitor, self.reason_filter)
        self._calling = CallController(numbers, self.reason_filter, self.holding, self.take_id)
        self._reasons: frozenset[Reason] = frozenset()
        self.shadow = Shadow()

    def restore(self, last_id: int, call: Call | None, hold: Hold | None, mode: int | None) -> None:
        """Take the state from before a restart. mode: the autopilot's custom_mode then, None if not known."""
        self.last_id = last_id
        self._calling.restore(call)
        self.holding.restore(hold)
        self.monitor.restore(mode)

    @_transition()
    def assessed(self, seen: Assessment, now: float, *, memory_stored: bool = True) -> list[Decision]:
        """Take in a judged frame.

        memory_stored: the memory that it was judged with is in the journal, or the disk did not take it in
        time. If not, the frame may start a hold, but does not count towards its end.
        """
        self.reason_filter.add_frame(seen, now, self.monitor.newest.travelled, memory_stored=memory_stored)
        self._calling.add_frame(seen)
        return self._settle(now)

    @_transition()
    def vehicle_reported(self, report: ModeReport, now: float) -> list[Decision]:
        """Take in a report of the autopilot. A mode that we did not command was set by a human, who wins."""
        return self._hold_moved(self.holding.vehicle_reported(report, now), now)

    @_transition()
    def mode_answered(self, answer: ModeAnswer, now: float) -> list[Decision]:
        """Take in the answer of the autopilot, or of its script, to a mode command."""
        return self._hold_moved(self.holding.mode_answered(answer, now), now)

    def _hold_moved(self, event: HoldEvent | None, now: float) -> list[Decision]:
        decisions: list[Decision] = []
        if event in (HoldEvent.CONFIRMED, HoldEvent.REBOOTED) and self.hold is not None:
            decisions.append(HoldMoved(self.hold, event))
        elif event is not None:
            decisions += self._end_hold(event, now)
        return decisions + self._settle(now)

    @_transition()
    def tick(self, now: float) -> list[Decision]:
        """Let time pass."""
        return self._settle(now)

    @_transition()
    def fault_reported(self, fault: Fault, what: str, now: float) -> list[Decision]:
        """Take in that `fault` stands. what: its name in two or three words, "" where it is over."""
        self.reason_filter.faults.report(fault, now, stands=bool(what), what=what)
        return self._settle(now)

    @_transition()
    def policy_changed(self, before: Policy, now: float) -> list[Decision]:
        """Follow a change of the policy in force, which was `before`.

        Without `hold` nothing is commanded any more, not even a resume. Only the release of our setpoints
        still is. After `off` it starts with nothing open or accepted.
        """
        policy = self.policy
        if policy is before:
            return []
        decisions: list[Decision] = [*self.shadow.stop(now)]
        if before is Policy.OFF:
            self.reason_filter.things.forget()
        self.reason_filter.faults.revoke()
        self.monitor.forget_reboot()
        if not policy.holds:
            self.reason_filter.faults.report(Fault.POLICY, now, stands=False)
            self.holding.release(now)
            dropped = self.holding.end()
            if dropped is not None:
                decisions.append(HoldMoved(dropped, HoldEvent.DROPPED))
        if policy is Policy.OFF:
            decisions += self._calling.close(Outcome.SWITCHED_OFF)
        return decisions + self._settle(now)

    def retune(self, judging: Settings) -> None:
        """Use other thresholds and another region of interest from now on."""
        self.numbers.judging = judging

    def resolve(self, target: int, now: float) -> int | None:
        """Return the id that an answer to `target` means (0: the current one), None where it is stale.

        An answer to 0 counts only where the current id was announced long enough ago to have been read.
        """
        current = self.current_id
        if current == 0 or target not in (0, current):
            return None
        read = now - self._announced_at() >= self.numbers.announce_guard
        return current if target == current or read else None

    @_transition()
    def apply_answer(
        self,
        target: int,
        motion: Motion,
        operations: Sequence[Operation],
        outcome: AnswerOutcome | None,
        now: float,
        *,
        go_at: float | None = None,
    ) -> tuple[Result, list[Decision]]:
        """Apply an answer to `target`, an id that `resolve` returned. Returns its result, too.

        outcome: the call's frame and the newest frame, judged again; None where neither was. go_at: when the
        answer was received. A go in it then has no effect before `confirm_go`. None: it counts at once.
        """
        if target == 0 or target != self.current_id:
            return Result.STALE, []
        result, clear = Result.APPLIED, self.stage() is Stage.CLEAR
        self.reason_filter.things.unblock(operations)
        if self.call is not None:
            result = answer_call(
                self.call,
                self.reason_filter,
                motion,
                operations,
                outcome,
                now,
                self.monitor.newest.travelled,
                clear=clear,
            )
        if motion is Motion.LOOK_AGAIN:
            self.reason_filter.reset_reasons()
            self.reason_filter.things.forget_blocking()
        if outcome is not None and outcome.newest is not None:
            self.reason_filter.replace_newest(outcome.newest, now)
        at = now if go_at is None else go_at
        self.holding.answer(motion if result is Result.APPLIED else Motion.NONE, at)
        if go_at is None:
            self.holding.confirm_go(at)
        return result, self._settle(now)

    @_transition()
    def confirm_go(self, at: float, now: float) -> list[Decision]:
        """Let the go that was received at `at` count from now on, as the journal has it, or was too slow.

        A go that was revoked meanwhile does not count.
        """
        self.holding.confirm_go(at)
        return self._settle(now)

    @property
    def policy(self) -> Policy:
        """The policy in force."""
        return self._policy_state.in_force

    @property
    def call(self) -> Call | None:
        """The open call, None without one."""
        return self._calling.call

    @property
    def hold(self) -> Hold | None:
        """The hold that is commanded or stands, None without one."""
        return self.holding.hold

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
        """Take the next id of the counter."""
        # 16 bits on the wire; 0 means the current call or hold, so it is no id.
        self.last_id = self.last_id % 0xFFFF + 1
        return self.last_id

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

    def fault_accepted(self, now: float) -> bool:
        """Whether faults stand, and nobody need be held for them.

        A human drives on in spite of all of them, or the vehicle stands after its mission.
        """
        stands = bool(self.reason_filter.standing_faults(now))
        return stands and (self.monitor.newest.mission_over or Reason.FAULT not in self.reasons(now))

    def autopilot_silent(self, now: float) -> bool:
        """Whether the policy is hold and the autopilot's heartbeats, which came before, have stopped."""
        return self.policy.holds and self.monitor.heartbeat_lost(now)

    def state(self, now: float) -> State:
        """Return the state for the heartbeat: what a human should know first."""
        if self.policy is Policy.OFF:
            return State.OFF
        reasons = self.reasons(now)
        # A fault that a human accepted still stands: the state must not say that all is well.
        if Reason.FAULT in reasons or self.reason_filter.standing_faults(now):
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
        self.reason_filter.tick(now)
        ending = self._tick_faults(now)
        self._reasons = reasons = self.reason_filter.reasons(now)
        released = self.holding.settle_release(now)
        if self.policy is Policy.OFF:
            return released
        decisions = ending + released + self._calling.settle(reasons, now)
        if self.policy is Policy.SHADOW:
            decisions += self._update_shadow(reasons, now)
        unasked = self._drives_unasked(now)
        wanted = bool(reasons) or unasked is not None
        if self.policy.holds and wanted and self.hold is None and self.monitor.drives_itself(now):
            number = self.call.id if self.call is not None else self.take_id()
            decisions.append(replace(self.holding.start(number, reasons, now), unasked=unasked))
            if unasked is not None:
                self.holding.require_go(anew=False)
        return decisions + self.holding.settle(reasons, self.call is not None, now)

    def _drives_unasked(self, now: float) -> Unasked | None:
        if self.monitor.drives_unasked(now):
            return Unasked.REBOOTED
        return Unasked.OVERRODE if self.holding.overrode(now) else None

    def _update_shadow(self, reasons: frozenset[Reason], now: float) -> list[Decision]:
        """Update the would-be hold.

        Without any autopilot it watches as if one drove, so that recorded pictures can be judged.
        """
        drives = self.monitor.drives_itself(now)
        return self.shadow.update(
            reasons,
            now,
            watching=self.monitor.newest.mode is None or drives,
            taken=self.monitor.known(now) and not drives,
            clear=self.reason_filter.ok_run >= self.numbers.ok_frames,
        )

    def _end_hold(self, event: HoldEvent, now: float) -> list[Decision]:
        """End the hold after a resume or a take-over. What a human drives past on their own is accepted."""
        hold, call = self.holding.end(), self.call
        assert hold is not None
        decisions: list[Decision] = [HoldMoved(hold, event)]
        if event is HoldEvent.TAKEN_OVER:
            accept_taken_over(call, self.reason_filter, now, self.monitor.newest.travelled)
            decisions += self._accept_faults(hold, now)
            return decisions + self._calling.close(Outcome.TAKEN_OVER)
        return decisions + (self._calling.close(call.outcome_now) if call is not None else [])

    def _accept_faults(self, hold: Hold, now: float) -> list[Decision]:
        """Accept the faults that stand, where a human drives on in an autopilot mode over a hold for them."""
        faults, report = self.reason_filter.faults, self.monitor.newest
        told = hold.confirmed_at is not None and now - hold.confirmed_at >= TOLD_FOR
        if not (told and report.drives_itself and self.reason_filter.standing_faults(now)):
            return []
        accepted = faults.accept(now, report.travelled)
        return [FaultAccepted(hold.id, accepted)] if accepted is not None or faults.refuses(now) else []

    def _tick_faults(self, now: float) -> list[Decision]:
        faults, travelled = self.reason_filter.faults, self.monitor.newest.travelled
        sees = self.reason_filter.ok_run >= self.numbers.ok_frames
        ending = faults.tick(now, travelled, sees=sees)
        return [] if ending is None else [FaultAcceptanceEnds(*ending.left(self.numbers, now, travelled))]
