"""The script for ArduPilot against stubs of its bindings: when it holds, what it says, whom it lets drive."""

from __future__ import annotations

import pytest

from companion.wire.ids import State
from tests.companion.sim.field.stubs import (
    AUTO,
    BY_GCS,
    BY_RC,
    CYCLE,
    GUIDED,
    HELD,
    HOLD,
    MANUAL,
    MISSION_COMMAND,
    RTL,
    SOURCE,
    Board,
    driving,
    until_held,
)

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


BACK = "Companion is back: nothing resumes by itself"


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
    assert board.texts(4)[-2:] == [BACK, "HOLD since companion silent: set AUTO by hand"]
    assert board.mode_now == HOLD


@pytest.mark.parametrize(("mode", "name"), [(AUTO, "AUTO"), (GUIDED, "GUIDED")])
@pytest.mark.parametrize("reason", ["companion silent", "companion fault", "obstacle feed dead"])
def test_a_hold_that_outlasts_its_cause_is_said_until_somebody_sets_a_mode(
    mode: int, name: str, reason: str
) -> None:
    board = driving()
    board.mode_now, board.sensors, board.status = mode, 1, 2
    board.pass_time(1.0, state=State.OK)
    if reason == "obstacle feed dead":
        board.status = 1
    board.pass_time(
        3.0, state={"companion silent": None, "companion fault": State.FAULT}.get(reason, State.OK)
    )
    assert board.mode_now == HOLD
    board.status = 2
    board.pass_time(31.0, state=State.OK)
    told = f"HOLD since {reason}: set {name} by hand"
    assert board.texts(4).count(told) == 4
    assert board.texts(4)[1] == BACK
    board.human_sets(mode)
    board.pass_time(60.0, state=State.OK)
    assert board.texts(4).count(told) == 4
    assert board.mode_now == mode


def test_disarming_ends_that_too() -> None:
    board = driving()
    until_held(board)
    board.pass_time(1.0, state=State.OK)
    board.armed = False
    board.pass_time(1.0, state=State.OK)
    board.armed = True
    said = len(board.said)
    board.pass_time(30.0, state=State.OK)
    assert len(board.said) == said


def test_a_hold_of_a_human_is_none_of_its_own() -> None:
    board = driving()
    board.human_sets(HOLD)
    board.pass_time(5.0)
    board.pass_time(30.0, state=State.OK)
    assert board.texts(4) == ["companion silent: guarded modes will be held", BACK]


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


def test_it_arms_nothing() -> None:
    assert "arming:arm" not in SOURCE
    assert "disarm" not in SOURCE.split("--]]")[1].replace("disarmed", "")
