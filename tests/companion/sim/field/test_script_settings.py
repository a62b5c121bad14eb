"""What an owner sets for ArduPilot's script: time-out, modes, policy, demand, obstacle feed, off switch."""

from __future__ import annotations

from typing import Any

import pytest

from companion.wire.ids import Policy, State
from tests.companion.sim.field.stubs import AUTO, CYCLE, HELD, HOLD, SOURCE, Board, driving, until_held

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


def test_the_timeout_is_a_parameter_kept_within_reason() -> None:
    waits = {}
    for value in (3.0, 0.0, float("nan"), 1e9):
        board = driving(ATS_TIMEOUT=value)
        waits[str(value)] = round(until_held(board), 1)
    assert waits["0.0"] == pytest.approx(1.2, abs=0.2)
    assert waits["nan"] == pytest.approx(1.5, abs=0.2)
    assert waits["3.0"] == pytest.approx(3.0, abs=0.2)
    assert waits["1000000000.0"] == pytest.approx(10.0, abs=0.2)


@pytest.mark.parametrize(("mode", "bit"), [(6, 64), (8, 256), (9, 512)])
def test_other_modes_that_drive_by_themselves_can_be_guarded(mode: int, bit: int) -> None:
    board, unguarded = driving(ATS_MODES=bit), driving()
    board.mode_now = unguarded.mode_now = mode
    assert until_held(board) <= 2.0
    unguarded.pass_time(10.0)
    assert unguarded.set_modes == []


class TestSwitchedOff:
    def test_by_its_parameter(self) -> None:
        board = driving()
        board.parameters["ATS_ENABLE"] = 0.0
        board.tell(b"C7 unknown thing ahead 38%: go/stay/word")
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
        assert board.texts(6)[-1] == "HOLD since companion silent: set AUTO by hand"

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


class TestNoNumber:
    """A parameter that holds no number counts as it was shipped."""

    def test_it_makes_no_script_act_in_report_policy(self) -> None:
        board = driving(policy=Policy.REPORT, ATS_POLICY=float("nan"), ATS_NEED=float("nan"))
        board.pass_time(30.0)
        assert board.set_modes == []
        assert board.scripting.forbids_arming() == ""

    @pytest.mark.parametrize("name", ["ENABLE", "TIMEOUT", "MODES", "FAULT", "PRX", "RC"])
    def test_nor_does_it_keep_one_from_holding(self, name: str) -> None:
        strange: dict[str, Any] = {f"ATS_{name}": float("nan")}
        board = driving(**strange)
        assert until_held(board) <= 1.5 + 2 * CYCLE


def test_the_header_documents_every_parameter_with_its_default() -> None:
    rows = [line.split("|") for line in SOURCE.splitlines() if line.startswith("| ATS_")]
    documented = {row[1].strip(): float(row[2]) for row in rows}
    shipped = {name: value for name, value in Board().parameters.items() if name.startswith("ATS_")}
    assert documented == shipped
