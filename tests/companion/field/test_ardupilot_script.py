"""The script for ArduPilot against stubs of its bindings: when it holds, what it says, whom it lets drive."""

from __future__ import annotations

from typing import Any

import pytest

from companion.wire.ids import Policy, State
from tests.companion.field.stubs import (
    AUTO,
    BY_GCS,
    BY_RC,
    CYCLE,
    GUIDED,
    HOLD,
    MANUAL,
    MISSION_COMMAND,
    RTL,
    SOURCE,
    Board,
    driving,
)

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

HELD = "HOLD: companion silent. AUTO again = go blind"


def until_held(board: Board, limit: float = 20.0) -> float:
    """Seconds until HOLD."""
    begun = board.t
    while board.mode_now != HOLD and board.t - begun < limit:
        board.pass_time(CYCLE)
    return board.t - begun


def test_boot_without_a_companion_is_silent_and_harmless() -> None:
    board = Board()
    board.pass_time(60.0)
    assert (board.said, board.set_modes) == ([], [])
    assert board.scripting.forbids_arming() == ""


def test_a_companion_that_is_well_is_left_in_peace() -> None:
    board = driving()
    for state in (State.OK, State.CALLING, State.HOLDING, State.BLOCKED, State.OFF):
        board.pass_time(5.0, state=state)
    assert board.set_modes == []
    assert board.texts() == ["Policy hold: loss of companion will be held"]


@pytest.mark.parametrize(("mode", "name"), [(AUTO, "AUTO"), (GUIDED, "GUIDED")])
def test_silence_holds_once_and_says_why_and_what_to_do(mode: int, name: str) -> None:
    board = driving()
    board.mode_now = mode
    assert until_held(board) <= 1.5 + 2 * CYCLE
    assert [mode for _, mode, _, _ in board.set_modes] == [HOLD]
    assert board.texts(2) == [f"HOLD: companion silent. {name} again = go blind"]


def test_the_timeout_is_a_parameter_kept_within_reason() -> None:
    waits = {}
    for value in (3.0, 0.0, float("nan"), 1e9):
        board = driving(ATS_TIMEOUT=value)
        waits[str(value)] = round(until_held(board), 1)
    assert waits["0.0"] == pytest.approx(1.2, abs=0.2)
    assert waits["nan"] == pytest.approx(1.5, abs=0.2)
    assert waits["3.0"] == pytest.approx(3.0, abs=0.2)
    assert waits["1000000000.0"] == pytest.approx(10.0, abs=0.2)


def test_the_text_of_a_hold_repeats_slowly_while_it_stands() -> None:
    board = driving()
    board.pass_time(100.0)
    assert board.texts(2) == [HELD] * 4


@pytest.mark.parametrize("mode", [MANUAL, HOLD, RTL, 5, 12, 3, 1])
def test_modes_of_a_human_or_a_failsafe_are_never_touched(mode: int) -> None:
    board = driving(ATS_MODES=65535)
    board.mode_now = mode
    board.pass_time(30.0)
    assert board.set_modes == []
    assert board.texts(4) == ["companion silent: guarded modes will be held"]


def test_a_disarmed_rover_is_left_alone_and_held_when_it_is_armed_in_auto() -> None:
    board = driving()
    board.armed = False
    board.pass_time(10.0)
    assert (board.set_modes, board.texts(4)) == ([], [])
    board.armed = True
    assert until_held(board) <= 2 * CYCLE


@pytest.mark.parametrize(("mode", "bit"), [(6, 64), (8, 256), (9, 512)])
def test_other_modes_that_drive_by_themselves_can_be_guarded(mode: int, bit: int) -> None:
    board, unguarded = driving(ATS_MODES=bit), driving()
    board.mode_now = unguarded.mode_now = mode
    assert until_held(board) <= 2.0
    unguarded.pass_time(10.0)
    assert unguarded.set_modes == []


def test_a_fault_holds_at_once_unless_the_owner_says_otherwise() -> None:
    board, deaf = driving(), driving(ATS_FAULT=0)
    for one in (board, deaf):
        one.pass_time(0.5, state=State.FAULT)
    assert board.texts(2) == ["HOLD: companion fault. AUTO again = go blind"]
    assert deaf.set_modes == []


def test_a_state_that_the_script_does_not_know_is_a_fault() -> None:
    board = driving()
    board.pass_time(0.5, state=77)
    assert board.mode_now == HOLD


def test_a_companion_that_restarts_quickly_is_gone_until_it_sees() -> None:
    board = driving()
    board.pass_time(4.0, state=State.STARTING)
    assert board.texts(2) == [HELD]
    board.pass_time(1.0, state=State.OK)
    assert board.texts(6)[-1] == "Companion is back: nothing resumes by itself"
    assert board.mode_now == HOLD


def test_one_that_starts_for_the_first_time_is_waited_for_and_guarded() -> None:
    board = Board()
    board.pass_time(20.0, state=State.STARTING)
    assert board.set_modes == []
    assert until_held(board) < 2.0


def test_one_that_was_switched_off_may_go() -> None:
    board, needed = driving(), driving(ATS_NEED=1)
    for one in (board, needed):
        one.pass_time(1.0, state=State.OFF)
        one.pass_time(30.0)
    assert board.set_modes == []
    assert needed.texts(2)[0] == "HOLD: companion is off. AUTO again = go blind"


class TestAHumanWins:
    @pytest.mark.parametrize("reason", [BY_RC, BY_GCS, 42, 53])
    def test_auto_set_again_after_the_hold_drives_without_the_companion_and_says_so(
        self, reason: int
    ) -> None:
        board = driving()
        until_held(board)
        board.human_sets(AUTO, reason)
        board.pass_time(40.0)
        assert board.mode_now == AUTO
        assert board.texts(4)[-2:] == ["AUTO without companion"] * 2

    def test_guided_set_again_is_told_that_its_target_is_lost(self) -> None:
        board = driving()
        until_held(board)
        board.human_sets(GUIDED)
        board.pass_time(1.0)
        assert board.texts(4)[-1] == "GUIDED without companion: send target again"

    def test_auto_by_anything_else_is_held_again(self) -> None:
        board = driving()
        until_held(board)
        board.human_sets(AUTO, MISSION_COMMAND)
        assert until_held(board) <= 2 * CYCLE

    def test_a_first_auto_after_the_loss_is_held_once(self) -> None:
        board = driving()
        board.mode_now = MANUAL
        board.pass_time(10.0)
        board.human_sets(AUTO)
        assert until_held(board) <= 2 * CYCLE
        board.human_sets(AUTO)
        board.pass_time(10.0)
        assert board.mode_now == AUTO

    def test_disarming_ends_what_was_accepted(self) -> None:
        board = driving()
        until_held(board)
        board.human_sets(AUTO)
        board.pass_time(1.0)
        board.armed = False
        board.pass_time(1.0)
        board.armed = True
        assert until_held(board) <= 2 * CYCLE

    def test_a_companion_that_comes_back_for_a_moment_is_not_held_again_one_that_stays_is(self) -> None:
        board = driving()
        until_held(board)
        board.human_sets(AUTO)
        board.pass_time(1.0)
        board.pass_time(2.0, state=State.OK)
        board.pass_time(10.0)
        assert board.mode_now == AUTO
        board.pass_time(8.0, state=State.OK)
        assert until_held(board) <= 2.0

    def test_a_resume_while_the_companion_is_well_is_no_licence_for_the_next_loss(self) -> None:
        board = driving()
        board.pass_time(0.5, state=State.FAULT)
        board.pass_time(1.0, state=State.OK)
        board.human_sets(AUTO)
        assert until_held(board) <= 2.0


def test_hold_that_is_refused_is_tried_again_then_said_as_an_alert_and_tried_slowly() -> None:
    board = driving()
    board.obeys = False
    board.pass_time(2.0)
    assert 3 <= len(board.set_modes) <= 4
    assert board.texts(1) == ["HOLD REFUSED, companion silent: take over"]
    board.pass_time(10.0)
    assert len(board.set_modes) <= 15
    assert 2 <= len(board.texts(1)) <= 4
    board.obeys = True
    assert until_held(board) <= 1.0 + 2 * CYCLE


class TestNeed:
    def test_arming_is_refused_until_a_companion_sees(self) -> None:
        board = Board(ATS_NEED=1)
        board.armed = False
        board.pass_time(1.0)
        assert board.scripting.forbids_arming() == "no companion: fix it or ATS_NEED 0"
        board.pass_time(3.0, state=State.STARTING)
        assert board.scripting.forbids_arming()
        board.pass_time(1.0, state=State.OK)
        assert board.scripting.forbids_arming() == ""
        board.pass_time(3.0)
        assert board.scripting.forbids_arming() == "companion silent: fix it or ATS_NEED 0"
        board.parameters["ATS_NEED"] = 0.0
        board.pass_time(1.0)
        assert board.scripting.forbids_arming() == ""

    def test_never_heard_is_gone(self) -> None:
        board = Board(ATS_NEED=1)
        assert until_held(board) <= 2 * CYCLE
        assert board.texts(2) == ["HOLD: no companion. AUTO again = go blind"]

    def test_it_survives_restarts_of_scripting_until_the_places_run_out(self) -> None:
        board = Board(ATS_NEED=1)
        for _ in range(4):
            board.scripting.restart()
            board.pass_time(1.0)
        assert board.scripting.ended == ""
        assert board.scripting.forbids_arming() == "Too many auxiliary authorisers"


class TestPolicy:
    @pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW, Policy.OFF])
    def test_where_the_companion_may_not_hold_its_silence_and_its_faults_stop_nobody(
        self, policy: Policy
    ) -> None:
        board = driving(policy=policy)
        board.pass_time(5.0, state=State.FAULT)
        board.pass_time(60.0)
        assert board.set_modes == []
        assert board.texts() == [f"Policy {policy.name.lower()}: loss of companion is not held"]

    def test_the_policy_heard_last_counts_and_each_is_told_once(self) -> None:
        board = driving(policy=Policy.SHADOW)
        board.policy = Policy.HOLD
        board.pass_time(2.0, state=State.OK)
        assert until_held(board) <= 1.5
        assert board.texts(6)[:2] == [
            "Policy shadow: loss of companion is not held",
            "Policy hold: loss of companion will be held",
        ]

    def test_one_that_leaves_policy_hold_may_go(self) -> None:
        board = driving()
        board.policy = Policy.REPORT
        board.pass_time(1.0, state=State.OK)
        board.pass_time(60.0)
        assert board.set_modes == []

    def test_one_that_restarts_with_less_is_a_loss_until_it_sees_and_then_may_go(self) -> None:
        board = driving()
        board.policy = Policy.REPORT
        board.pass_time(4.0, state=State.STARTING)
        assert board.texts(2) == [HELD]
        board.pass_time(1.0, state=State.OK)
        board.human_sets(AUTO)
        board.pass_time(60.0)
        assert board.mode_now == AUTO
        assert board.texts(6)[-1] == "Companion is back: nothing resumes by itself"

    @pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW])
    def test_an_owner_may_ask_for_the_stop_in_these_policies_too(self, policy: Policy) -> None:
        silent, faulty = (driving(policy=policy, ATS_POLICY=1) for _ in range(2))
        assert until_held(silent) <= 1.5 + 2 * CYCLE
        faulty.pass_time(0.5, state=State.FAULT)
        assert faulty.texts(2) == ["HOLD: companion fault. AUTO again = go blind"]

    def test_but_never_in_policy_off(self) -> None:
        board = driving(policy=Policy.OFF, ATS_POLICY=1)
        board.pass_time(60.0)
        assert board.set_modes == []

    @pytest.mark.parametrize("policy", Policy)
    def test_one_that_is_demanded_is_demanded_in_every_policy(self, policy: Policy) -> None:
        board = driving(policy=policy, ATS_NEED=1)
        assert until_held(board) <= 1.5 + 2 * CYCLE

    def test_after_a_restart_of_scripting_the_policy_is_unknown_until_it_is_heard(self) -> None:
        board = driving()
        board.scripting.restart()
        board.pass_time(30.0)
        assert board.set_modes == []
        board.pass_time(1.0, state=State.OK)
        assert until_held(board) <= 1.5

    def test_a_script_that_fails_holds_nobody_either(self) -> None:
        board, demanded = driving(policy=Policy.SHADOW), driving(policy=Policy.SHADOW, ATS_NEED=1)
        for one in (board, demanded):
            one.broken = {"parameter"}
            one.pass_time(5.0)
        assert (board.set_modes, demanded.mode_now) == ([], HOLD)

    def test_nor_does_one_that_is_switched_off_or_without_a_companion(self) -> None:
        for board in (driving(ATS_ENABLE=0), Board()):
            board.broken = {"is_armed"}
            board.pass_time(2.0)
            board.broken = {"parameter"}
            board.pass_time(2.0)
            assert board.set_modes == []


class TestObstacleFeed:
    def feeding(self, **parameters: Any) -> Board:
        board = driving(**parameters)
        board.sensors, board.status = 1, 2
        board.pass_time(2.0, state=State.OK)
        return board

    def test_a_feed_that_dies_while_in_use_holds(self) -> None:
        board = self.feeding()
        board.status = 1
        board.pass_time(1.0, state=State.OK)
        assert board.texts(2) == ["HOLD: obstacle feed dead. AUTO again = go blind"]

    @pytest.mark.parametrize(
        "parameters",
        [{"ATS_PRX": 0}, {"AVOID_ENABLE": 1}, {"policy": Policy.SHADOW}],
        ids=["switched off", "not avoided by", "not to be held"],
    )
    def test_a_feed_that_is_not_in_use_may_die(self, parameters: dict[str, Any]) -> None:
        board = self.feeding(**parameters)
        board.status = 1
        board.pass_time(5.0, state=State.OK)
        assert board.set_modes == []

    def test_one_that_never_lived_holds_only_where_it_is_demanded(self) -> None:
        for need, held in ((0, False), (1, True)):
            board = driving(ATS_NEED=need)
            board.sensors, board.status = 1, 1
            board.pass_time(3.0, state=State.OK)
            assert (board.mode_now == HOLD) is held

    def test_a_path_planner_uses_it_too(self) -> None:
        board = self.feeding(AVOID_ENABLE=0, OA_TYPE=1)
        board.status = 1
        board.pass_time(1.0, state=State.OK)
        assert board.mode_now == HOLD


class TestSwitchedOff:
    def test_by_its_parameter(self) -> None:
        board = driving()
        board.parameters["ATS_ENABLE"] = 0.0
        board.tell(b"C7 unknown thing ahead 38%: ok/stay/word")
        board.pass_time(10.0)
        assert board.set_modes == []
        assert board.texts(4) == ["Companion guard is off: ATS_ENABLE or switch"]
        board.parameters["ATS_ENABLE"] = 1.0
        assert until_held(board) <= 2 * CYCLE

    def test_by_a_switch_of_the_transmitter(self) -> None:
        board = driving(ATS_RC=300)
        board.switches[300] = 2
        board.pass_time(10.0)
        assert board.set_modes == []
        board.switches[300] = 1
        assert until_held(board) <= 2 * CYCLE


class TestItsOwnFailures:
    def test_one_error_is_told_and_survived(self) -> None:
        board = driving()
        board.broken = {"mode"}
        board.beat(State.FAULT)
        board.pass_time(CYCLE)
        board.broken = set()
        board.pass_time(CYCLE)
        assert board.texts(1)[0].startswith("anytraverse.lua: ")
        assert board.mode_now == HOLD

    def test_a_script_that_keeps_failing_holds_once(self) -> None:
        board = driving()
        board.broken = {"parameter"}
        board.pass_time(0.5)
        assert board.mode_now == HOLD
        board.human_sets(AUTO)
        board.pass_time(20.0)
        assert board.mode_now == AUTO
        assert len(board.texts(1)) == 5

    @pytest.mark.parametrize("mode", [MANUAL, RTL])
    def test_even_then_it_leaves_other_modes_alone(self, mode: int) -> None:
        board = driving()
        board.broken, board.mode_now = {"parameter"}, mode
        board.pass_time(5.0)
        assert board.set_modes == []

    def test_texts_that_cannot_be_sent_do_not_keep_it_from_holding(self) -> None:
        board = driving()
        board.broken = {"send_text"}
        assert until_held(board) <= 2.0

    def test_set_up_that_fails_is_told_and_forbids_arming(self) -> None:
        board = Board(SYSID_THISMAV=float("nan"))
        assert board.scripting.ended == ""
        del board.parameters["SYSID_THISMAV"]
        board.scripting.restart()
        board.pass_time(60.0)
        assert board.texts(1) == ["anytraverse.lua: no system id"] * len(board.texts(1))
        assert board.scripting.forbids_arming() == "anytraverse.lua failed: see messages"


def test_millis_may_wrap_around() -> None:
    board = Board(start_ms=2**32 - 4000)
    board.pass_time(6.0, state=State.OK)
    assert board.set_modes == []
    assert until_held(board) <= 2.5


def test_a_loss_of_fifty_days_is_still_one() -> None:
    board = driving()
    board.mode_now = MANUAL
    board.pass_time(10.0)
    board.ms += 2**32 - 10_000
    board.mode_now = AUTO
    assert until_held(board) <= 2 * CYCLE


def test_a_pause_of_the_autopilot_is_no_loss_when_heartbeats_wait() -> None:
    board = driving()
    for _ in range(5):
        board.ms += 1000
        board.beat()
    board.pass_time(0.5)
    assert board.set_modes == []


def test_it_arms_nothing() -> None:
    assert "arming:arm" not in SOURCE
    assert "disarm" not in SOURCE.split("--]]")[1].replace("disarmed", "")


def test_the_header_documents_every_parameter_with_its_default() -> None:
    rows = [line.split("|") for line in SOURCE.splitlines() if line.startswith("| ATS_")]
    documented = {row[1].strip(): float(row[2]) for row in rows}
    shipped = {name: value for name, value in Board().parameters.items() if name.startswith("ATS_")}
    assert documented == shipped
