"""The script for ArduPilot when it fails itself, and when time plays tricks on it."""

from __future__ import annotations

import pytest

from companion.sim.field.scripting import Scripting
from companion.wire.ids import State
from tests.companion.sim.field.stubs import AUTO, CYCLE, HOLD, MANUAL, RTL, Board, driving, until_held

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")


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
    for _ in range(12):
        board.ms += 1000
        board.beat()
    board.pass_time(0.5)
    assert board.set_modes == []


def test_what_waited_while_scripting_was_stopped_is_no_news() -> None:
    board = driving()
    for _ in range(20):
        board.ms += 1000
        board.beat(State.FAULT)
        board.tell(b"C7 unknown thing ahead 38%: go/stay/word")
    said = len(board.said)
    board.scripting.restart()
    board.pass_time(2 * CYCLE)
    board.beat()
    board.pass_time(1.0)
    assert board.set_modes == []
    assert board.texts()[said:] == ["Policy hold: loss of companion will be held"]
    assert until_held(board) <= 1.0


def test_it_needs_nothing_that_real_scripts_have_not() -> None:
    board = Board()
    source = "assert(not (select or setmetatable or rawget or load or debug)) return function() end, 9"
    board.scripting = Scripting(source, "probe.lua", board)
    board.scripting.poll()
    assert board.scripting.ended == ""


def test_a_script_with_more_local_variables_than_the_autopilot_allows_does_not_load() -> None:
    one_too_many = "\n".join(f"local v{number}" for number in range(101))
    with pytest.raises(ValueError, match="too many local variables"):
        Scripting(one_too_many, "many.lua", Board())
    Scripting(one_too_many.removesuffix("\nlocal v100"), "many.lua", Board())
