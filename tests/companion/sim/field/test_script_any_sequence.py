"""The script for ArduPilot on any sequence of heartbeats, modes, arming and time: what it never does, and
what it always does."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.wire.ids import Policy, State
from tests.companion.sim.field.stubs import (
    AUTO,
    BY_GCS,
    CYCLE,
    GUIDED,
    HOLD,
    MANUAL,
    MISSION_COMMAND,
    RTL,
    Board,
)

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

GUARDED = {AUTO, GUIDED}
MODES = [AUTO, GUIDED, MANUAL, HOLD, RTL, 5]
LIMIT = 1.5 + 2 * CYCLE

Step = tuple[str, float]
steps = st.one_of(
    st.tuples(st.just("beat"), st.sampled_from([float(state) for state in State])),
    st.tuples(st.just("wait"), st.sampled_from([0.1, 0.3, 1.0, 2.0, 7.0])),
    st.tuples(st.just("human"), st.sampled_from([float(mode) for mode in MODES])),
    st.tuples(st.just("mission"), st.sampled_from([float(mode) for mode in MODES])),
    st.tuples(st.just("arm"), st.sampled_from([0.0, 1.0])),
    st.tuples(st.just("obeys"), st.sampled_from([0.0, 1.0])),
    st.tuples(st.just("feed"), st.sampled_from([0.0, 1.0, 2.0])),
)
policies = st.tuples(st.just("policy"), st.sampled_from([float(policy) for policy in Policy]))


class Witness:
    """Follows a board and knows when the rover may not drive by itself any more."""

    def __init__(self, *, need: bool, every_policy: bool = False) -> None:
        self.board = Board(ATS_NEED=float(need), ATS_POLICY=float(every_policy))
        self.need, self.every_policy = need, every_policy
        self.watched = need
        self.last_beat: float | None = -1.0 if need else None
        self.off = False
        self.since = 0.0
        self.licensed = False

    def take(self, do: str, value: float) -> None:
        board = self.board
        if do == "beat":
            self._beat(State(int(value)))
        elif do == "policy":
            board.policy = Policy(int(value))
        elif do == "arm":
            board.armed = bool(value)
            self.since = board.t
        elif do == "obeys":
            board.obeys = bool(value)
            self.since = board.t
        elif do == "feed":
            board.sensors, board.status = int(value > 0), int(value)
        elif do in ("human", "mission"):
            board.human_sets(int(value), BY_GCS if do == "human" else MISSION_COMMAND)
            self.licensed |= do == "human" and value in GUARDED and bool(board.set_modes)
            self.since = board.t
        for _ in range(round((value if do == "wait" else 0.1) / CYCLE)):
            board.pass_time(CYCLE)
            self.check()

    def _beat(self, state: State) -> None:
        self.board.beat(state)
        if state is not State.STARTING or not self.watched:
            self.last_beat, self.off = self.board.t, self._lets_go(state, self.board.policy)
        self.watched |= state is not State.STARTING

    def _lets_go(self, state: State, policy: Policy) -> bool:
        if self.need:
            return False
        off = policy is Policy.OFF or state is State.OFF
        return off or not (self.every_policy or policy.holds)

    def check(self) -> None:
        board = self.board
        for _, asked, before, armed in board.set_modes:
            assert (asked, armed) == (HOLD, True)
            assert before in GUARDED
        if self.last_beat is None or self.off or self.licensed or not board.obeys or not board.armed:
            return
        if board.t - self.last_beat > LIMIT and board.t - self.since > LIMIT:
            assert board.mode_now not in GUARDED, "it drives without its companion"


@pytest.mark.slow
@settings(max_examples=150)
@given(sequence=st.lists(steps, max_size=30), need=st.booleans(), every_policy=st.booleans())
def test_it_sets_hold_alone_in_guarded_modes_alone_while_armed_and_never_too_late(
    sequence: list[Step], need: bool, every_policy: bool
) -> None:
    witness = Witness(need=need, every_policy=every_policy)
    for do, value in sequence:
        witness.take(do, value)
    assert witness.board.scripting.ended == ""
    assert not [text for text in witness.board.texts() if "anytraverse.lua" in text]


@settings(max_examples=100)
@given(sequence=st.lists(st.one_of(steps, policies), max_size=30), every_policy=st.booleans())
def test_nor_is_it_late_when_the_policy_changes_on_the_way(sequence: list[Step], every_policy: bool) -> None:
    witness = Witness(need=False, every_policy=every_policy)
    for do, value in sequence:
        witness.take(do, value)
    assert witness.board.scripting.ended == ""


@settings(max_examples=100)
@given(
    sequence=st.lists(steps, max_size=30),
    policy=st.sampled_from([Policy.REPORT, Policy.SHADOW, Policy.OFF]),
)
def test_a_rover_whose_companion_may_not_hold_it_is_never_held_by_the_script(
    sequence: list[Step], policy: Policy
) -> None:
    witness = Witness(need=False)
    witness.board.policy = policy
    for do, value in sequence:
        witness.take(do, value)
    assert witness.board.set_modes == []
    assert witness.board.scripting.forbids_arming() == ""


@settings(max_examples=60)
@given(sequence=st.lists(steps, max_size=20))
def test_after_a_human_s_second_word_it_holds_no_more_while_the_companion_is_away(
    sequence: list[Step],
) -> None:
    board = Board()
    board.pass_time(2.0, state=State.OK)
    board.pass_time(3.0)
    assert board.mode_now == HOLD
    board.human_sets(AUTO)
    board.pass_time(CYCLE)
    held = len(board.set_modes)
    for do, value in sequence:
        if do == "human":
            board.human_sets(int(value))
        board.pass_time(value if do == "wait" else CYCLE)
    assert len(board.set_modes) == held


@settings(max_examples=60)
@given(sequence=st.lists(steps, max_size=25))
def test_a_script_that_is_switched_off_does_nothing(sequence: list[Step]) -> None:
    board = Board(ATS_ENABLE=0.0, ATS_NEED=1.0)
    for do, value in sequence:
        if do == "beat":
            board.beat(State(int(value)))
        elif do == "human":
            board.human_sets(int(value))
        board.pass_time(value if do == "wait" else CYCLE)
    assert board.set_modes == []
    assert board.scripting.forbids_arming() == ""
