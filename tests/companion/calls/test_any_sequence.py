"""Whatever comes in whatever order: what must never be decided, and what must always be."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from anytraverse.assessment import Reason
from companion.calls.decisions import (
    CallClosed,
    CallOpened,
    Decision,
    HoldMoved,
    HoldRenamed,
    HoldShown,
    HoldStarted,
    SetMode,
)
from companion.calls.mode_monitor import ModeReport
from companion.calls.snapshot import restore, snapshot
from companion.calls.summary import current_text
from companion.vehicle import ardupilot, px4
from companion.wire.ids import Kind, Motion, Outcome, Policy, Result, Stage, State
from tests.companion.calls.scenes import (
    AHEAD,
    AUTO,
    BESIDE,
    BROKEN,
    CLEAR,
    DRUM,
    ELSEWHERE,
    GUIDED,
    HOLD,
    LOG,
    MANUAL,
    RTL,
    Scene,
    Thing,
    View,
)

VIEWS = [
    CLEAR,
    CLEAR,
    DRUM,
    LOG,
    BROKEN,
    ELSEWHERE,
    View((Thing(AHEAD), Thing(BESIDE, "tent"))),
    View((Thing(AHEAD, unsure=0.24),)),
    View(turned=60.0, pending=True),
]
WORDS: list[dict[str, float] | None] = [None, None, {"drum": 1.0}, {"drum": -1.0}, {"puddle": 1.0}]
PAUSES = st.sampled_from([0.02, 0.02, 0.3, 0.3, 0.6, 1.1, 4.0, 6.0, 21.0, 61.0])
SILENCE, T, N = 5.0, 1.0, 5


class Calls(RuleBasedStateMachine):
    """Feeds the state machine and keeps books of its own about modes, frames, answers and ids."""

    kind = ardupilot.ROVER
    modes = (*[AUTO] * 5, GUIDED, HOLD, MANUAL, RTL, ardupilot.INITIALISING)

    def __init__(self) -> None:
        super().__init__()
        self.scene = Scene()
        self.mode, self.armed, self.heard_at = 0, False, float("-inf")
        self.go_at: float | None = None
        self.bad_at = self.good_at = self.excused_at = self.scene.now
        self.run = 0
        self.open: int | None = None
        self.hold: int | None = None
        self.shown = False
        self.before = 0
        self.highest = 0
        self.closed: list[int] = []

    @initialize(
        policy=st.sampled_from([*Policy, *[Policy.HOLD] * 8]),
        ends=st.booleans(),
        latency=st.sampled_from([0.05, 0.05, 0.4, 0.8]),
    )
    def begin(self, policy: Policy, ends: bool, latency: float) -> None:
        self.scene = Scene(policy, fault_ends_hold=ends, latency=latency)
        self.bad_at = self.good_at = self.excused_at = self.scene.now
        self._hear(self.modes[0], True)  # noqa: FBT003

    @rule(views=st.lists(st.sampled_from(VIEWS), min_size=1, max_size=3), times=st.integers(1, 4))
    def frames(self, views: list[View], times: int) -> None:
        """Frames at ten a second."""
        for view in views * times:
            self._frame(view)

    @rule(count=st.integers(5, 12), view=st.sampled_from([CLEAR, CLEAR, DRUM, LOG]))
    def many(self, count: int, view: View) -> None:
        """The same frame for a while."""
        for _ in range(count):
            self._frame(view)

    @rule(pause=PAUSES)
    def nothing_comes(self, pause: float) -> None:
        """Time passes without frames, in ticks."""
        for _ in range(4):
            self.scene.now += pause / 4
            self._books(good=None)
            self._check(self.scene.calls.tick(self.scene.now))

    @rule(place=st.integers(0, 9), armed=st.sampled_from([*[True] * 9, False]))
    def heartbeat(self, place: int, armed: bool) -> None:
        """Any mode at any moment: a human's, or the autopilot's own."""
        self._hear(self.modes[place], armed)

    @precondition(lambda self: self.scene.calls.hold is not None)
    @rule(view=st.sampled_from([CLEAR, CLEAR, DRUM]), words=st.sampled_from(WORDS), count=st.integers(3, 7))
    def all_goes_well(self, view: View, words: Mapping[str, float] | None, count: int) -> None:
        """The autopilot holds, the operator says go, frames come, and the autopilot follows."""
        self.obedience()
        self._frame(view)
        self.answer(Motion.GO, words, 1)
        for _ in range(count):
            self._frame(view)
        if self.scene.calls.hold is not None:
            self.obedience()

    @precondition(lambda self: self.scene.calls.hold is not None)
    @rule()
    def obedience(self) -> None:
        """The autopilot does what the hold wants."""
        wanted = self.scene.hold.wanted_mode
        self._hear(self.scene.hold.mode if wanted is None else wanted, True)  # noqa: FBT003

    @rule(motion=st.sampled_from(Motion), words=st.sampled_from(WORDS), stale=st.integers(0, 9))
    def answer(self, motion: Motion, words: Mapping[str, float] | None, stale: int) -> None:
        """An answer, now and then to something that is not open."""
        scene = self.scene
        if scene.frame == 0:
            return
        target = scene.calls.current_id + 1 if stale == 0 else scene.calls.current_id
        was = scene.calls.current_id
        before = len(scene.log)
        result = scene.answer(motion, words, target)
        assert (result is Result.STALE) is (target == 0 or target != was)
        if result is not Result.STALE:
            self.excused_at = self.scene.now
            if motion is not Motion.GO or result is Result.NOT_COVERED:
                self.go_at = None
            else:
                if self.go_at is None:
                    self.run = self.run if self._resuming() else 0
                self.go_at = self.scene.now
        self._check([decision for _, decision in scene.log[before:]])

    @precondition(lambda self: self.scene.frame % 3 == 0)
    @rule(policy=st.sampled_from([*Policy, *[Policy.HOLD] * 8]))
    def switch(self, policy: Policy) -> None:
        """Another policy."""
        self._check(self.scene.requested(policy))

    @precondition(lambda self: self.scene.frame % 5 == 0)
    @rule()
    def restart(self) -> None:
        """The daemon is killed and comes back."""
        kept = json.loads(json.dumps(snapshot(self.scene.calls)))
        self.scene.restarted()
        self.go_at, self.run, self.shown = None, 0, False
        self.heard_at = float("-inf")
        self.bad_at = self.good_at = self.excused_at = self.scene.now
        assert self.scene.calls.current_id == (kept["call"] or kept["hold"] or {"id": 0})["id"]

    @invariant()
    def call_and_hold_share_one_id(self) -> None:
        calls = self.scene.calls
        if calls.call is not None and calls.hold is not None:
            assert calls.call.id == calls.hold.id
        assert (calls.call.id if calls.call else None) == self.open
        assert (calls.hold.id if calls.hold else None) == self.hold
        assert calls.current_id == (self.open or self.hold or 0)

    @invariant()
    def no_hold_without_the_hold_policy(self) -> None:
        assert self.scene.calls.hold is None or self.scene.calls.policy.holds

    @invariant()
    def nothing_is_open_when_off(self) -> None:
        assert self.scene.calls.policy is not Policy.OFF or self.scene.calls.current_id == 0

    @invariant()
    def an_answered_call_is_open_only_while_its_hold_stands(self) -> None:
        calls = self.scene.calls
        assert calls.call is None or not calls.call.answered or calls.hold is not None

    @invariant()
    def a_rebooted_rover_that_is_armed_to_drive_by_itself_is_held_again(self) -> None:
        hold = self.scene.calls.hold
        if hold is not None and hold.rebooted:
            assert not (self.armed and self.mode in self.kind.holdable)

    @invariant()
    def a_go_waits_only_for_a_hold(self) -> None:
        assert self.scene.calls.go_at is None or self.scene.calls.hold is not None

    @invariant()
    def nothing_ok_within_t_holds_a_rover_that_drives_itself(self) -> None:
        calls = self.scene.calls
        drives = self.armed and self.mode in self.kind.holdable and self.scene.now - self.heard_at < SILENCE
        late = self.scene.now - max(self.good_at, self.excused_at) > T + 1e-6
        # A human may have accepted the fault, also while the autopilot counts as silent.
        accepted = calls.reason_filter.standing_faults(self.scene.now) and Reason.FAULT not in (
            calls.reason_filter.reasons(self.scene.now)
        )
        if calls.policy.holds and drives and late and not accepted:
            assert calls.hold is not None

    @invariant()
    def an_autopilot_that_falls_silent_is_a_fault_where_the_rover_is_to_be_held(self) -> None:
        calls, heard = self.scene.calls, self.heard_at > float("-inf")
        if not calls.policy.holds or not heard:
            assert calls.reasons(self.scene.now) == calls.reason_filter.reasons(self.scene.now)
        elif self.scene.now - self.heard_at > 3.0:
            assert calls.state(self.scene.now) is State.FAULT

    @invariant()
    def it_can_always_be_told_and_kept(self) -> None:
        calls = self.scene.calls
        said = current_text(calls, [], self.scene.now)
        assert len(said.encode()) <= 50
        assert bool(said) is (calls.current_id != 0)
        assert (calls.stage() is Stage.CLOSED) is (calls.current_id == 0)
        assert calls.kind in Kind
        calls.state(self.scene.now)
        again = Scene(calls.policy).calls
        restore(again, json.loads(json.dumps(snapshot(calls))), self.scene.now)
        assert again.current_id == calls.current_id

    def _frame(self, view: View) -> None:
        scene = self.scene
        scene.now += 0.1
        scene.frame += 1
        scene.frames[scene.frame], scene.view = view, view
        seen = scene.judged(scene.frame)
        accepted = scene.calls.reason_filter.things.accepted
        self._books(good=seen.reasons <= accepted)
        self._check(scene.calls.assessed(seen, self.scene.now))

    def _books(self, *, good: bool | None) -> None:
        """good: whether a frame could be OK; None: no frame."""
        if good:
            self.run = self.run + 1 if self.scene.now - max(self.good_at, self.bad_at) <= T else 1
            self.good_at = max(self.good_at, self.scene.now - self.scene.latency)
        elif good is False or self.scene.now - max(self.good_at, self.bad_at) > T:
            self.run, self.bad_at = 0, self.scene.now

    def _hear(self, mode: int, armed: bool) -> None:
        self.mode, self.armed, self.heard_at = mode, armed, self.scene.now
        report = ModeReport(mode, armed, None, self.scene.now, self.kind, takes_resume=True)
        decisions = self.scene.calls.vehicle_reported(report, self.scene.now)
        if any(isinstance(one, HoldMoved) and one.event.value == "taken over" for one in decisions):
            self.excused_at = self.scene.now
        self._check(decisions)

    def _resuming(self) -> bool:
        hold = self.scene.calls.hold
        return hold is not None and hold.state.value == "resuming"

    def _check(self, decisions: Iterable[Decision]) -> None:
        for decision in decisions:
            self._check_one(decision)

    def _check_one(self, decision: Decision) -> None:
        match decision:
            case SetMode(mode) if self.mode in self.kind.streamed and mode == self.kind.rest_mode:
                assert self.armed, "a hold that may not stand on is handed over, once it is given up"
                assert self.hold is None
            case SetMode(mode):
                assert self.scene.calls.policy.holds
                assert self.hold is not None
                assert self.armed
                assert self.scene.now - self.heard_at <= SILENCE
                if mode == self.kind.hold_mode:
                    assert self.mode in (*self.kind.holdable, mode)
                else:
                    self._check_way_back(mode)
            case CallOpened(call):
                assert self.open is None
                assert call.id > self.highest
                self.open = self.highest = call.id
                self.go_at = None
            case CallClosed(call):
                assert call.id == self.open
                assert call.id not in self.closed
                assert call.outcome is not Outcome.NONE
                self.closed.append(call.id)
                self.open = None
            case HoldStarted(hold, reasons, unasked):
                assert reasons or unasked is not None
                assert self.hold is None
                assert self.mode in self.kind.holdable
                assert hold.id == self.open or hold.id > self.highest
                self.hold, self.before, self.shown = hold.id, self.mode, False
                self.highest = max(self.highest, hold.id)
                self.go_at = None
            case HoldShown(hold, seen):
                assert hold.id == self.hold
                assert self.open is None
                assert not self.shown, "one picture for each hold, whatever comes and goes"
                assert Reason.BLOCKED in seen.reasons
                assert hold.seen is seen
                self.shown = True
            case HoldRenamed(old, hold):
                assert old == self.hold
                self.hold = hold.id
            case HoldMoved(hold, event):
                assert hold.id == self.hold
                self.before = hold.mode_before  # a reboot may have changed it
                if event.value in ("taken over", "resumed", "dropped"):
                    self.hold = self.go_at = None

    def _check_way_back(self, mode: int) -> None:
        assert mode == self.before
        assert self.mode == self.scene.hold.mode
        assert self.mode in (self.kind.hold_mode, self.kind.rest_mode)
        assert self.run >= N
        if self.go_at is not None:
            assert self.bad_at - self.go_at <= 60.0 + 1e-6
        else:
            assert self.scene.numbers.fault_ends_hold
            assert self.open is None


class Px4Calls(Calls):
    """The same on PX4, held in LOITER."""

    kind = px4.LOITERING
    modes = (*[px4.MISSION] * 5, px4.OFFBOARD, px4.LOITER, MANUAL, px4.custom_mode(1), px4.custom_mode(3))


class Px4OffboardCalls(Px4Calls):
    """The same on PX4, held in OFFBOARD: setpoints stream for our own hold, until something else stands."""

    kind = px4.OFFBOARD_HOLD

    @invariant()
    def setpoints_go_as_long_as_the_hold_stands(self) -> None:
        holding = self.scene.calls.holding
        ours = holding.hold is not None and holding.hold.mode == px4.OFFBOARD
        known = self.scene.calls.monitor.newest.autopilot is not None
        assert holding.streams is (ours and known) or holding.offboard_release is not None

    @invariant()
    def setpoints_do_not_outlast_the_mode(self) -> None:
        holding = self.scene.calls.holding
        if holding.hold is None and self.mode not in (px4.OFFBOARD, px4.MISSION):
            assert not holding.streams


Calls.TestCase.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)
Px4Calls.TestCase.settings = Px4OffboardCalls.TestCase.settings = settings(
    max_examples=60, stateful_step_count=40, deadline=None
)
TestAnySequence = Calls.TestCase
TestAnySequenceOnPx4 = Px4Calls.TestCase
TestAnySequenceOnPx4InOffboard = Px4OffboardCalls.TestCase
