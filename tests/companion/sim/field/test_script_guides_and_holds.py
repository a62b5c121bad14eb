"""A HOLD while the script guides brakes in a GUIDED of its own, and whoever takes over has the rover."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import State
from tests.companion.sim.field.guiding import (
    ACCEPTED,
    CHANGED,
    DENIED,
    FAILED,
    GUIDE,
    IN_PROGRESS,
    LONGEST,
    LOST,
    STATION,
    Guiding,
    own_target,
)
from tests.companion.sim.field.stubs import AUTO, BY_GCS, BY_RC, CYCLE, GUIDED, HOLD, MANUAL, RTL, SCRIPTING
from tests.companion.sim.field.test_script_brakes import COMMANDS, set_guided

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

OVER = LOST + LONGEST + 1.0


def test_a_hold_enters_guided_anew_to_brake_and_holds_once_the_rover_stands() -> None:
    asked = Guiding().guided()
    taken = asked.serial
    asked.streams = False
    assert asked.answers(lambda: asked.send(HOLD, GUIDED)) == [
        (taken, ACCEPTED),
        (asked.serial, IN_PROGRESS),
    ]
    assert asked.set_modes == [HOLD, GUIDED]
    assert asked.shows == (GUIDED, SCRIPTING)
    assert asked.answers(seconds=1.0) == []
    asked.board.moves_at = 0.09
    assert asked.answers() == [(asked.serial, ACCEPTED)]
    assert asked.set_modes == [HOLD, GUIDED, HOLD]
    assert asked.ask(AUTO, HOLD, hold=8) == [FAILED]
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


@pytest.mark.parametrize("why", ["no time", "stands", "boat"])
def test_it_holds_at_once_where_it_would_not_brake_out_of_auto(why: str) -> None:
    parameters = {"FRAME_CLASS": 2.0} if why == "boat" else {}
    asked = Guiding(0.0 if why == "no time" else LONGEST, **parameters).guided()
    asked.board.moves_at = 0.0 if why == "stands" else 1.0
    assert asked.ask(HOLD, GUIDED) == [ACCEPTED, ACCEPTED]
    assert asked.set_modes == [HOLD]


@pytest.mark.parametrize("state", [State.FAULT, None])
def test_so_does_the_script_s_own_hold(state: State | None) -> None:
    asked = Guiding(2.0, ATS_TIMEOUT=1.2).guided()
    taken = asked.serial
    asked.beats = state is not None
    told = (
        asked.answers(seconds=1.4) if state is None else asked.answers(lambda: asked.live(0.2, State.FAULT))
    )
    assert told == [(taken, ACCEPTED)]
    assert asked.set_modes[:2] == [HOLD, GUIDED]
    assert asked.board.texts(2)[0].startswith("Braking: companion")


@pytest.mark.parametrize("seconds", [0.0, 2.0])
def test_out_of_guiding_it_says_that_auto_drives_on_also_where_the_heartbeat_is_lost_first(
    seconds: float,
) -> None:
    asked = Guiding(seconds, ATS_TIMEOUT=1.2).guided()
    asked.beats = False
    asked.live(1.4)
    asked.streams = False
    asked.live(6.0)
    assert asked.shows == (HOLD, SCRIPTING)
    assert "HOLD: companion silent. AUTO again = go blind" in asked.board.texts(2)
    asked.beats = True
    asked.live(12.0)
    assert asked.board.texts(4)[-1] == "HOLD since companion silent: set AUTO by hand"


def test_a_hold_ends_the_stream_s_way_and_a_target_that_comes_late_ends_the_brake_in_hold() -> None:
    asked = Guiding().guided()
    assert asked.ask(HOLD, GUIDED)[-1] == IN_PROGRESS
    # The stream goes on: each of its targets would have the rover drive again.
    assert asked.answers(seconds=2 * CYCLE) == [(asked.serial, ACCEPTED)]
    assert asked.shows == (HOLD, SCRIPTING)


def test_a_target_that_was_sent_before_the_hold_does_not_end_the_brake() -> None:
    asked = Guiding().guided()
    asked.streams = False
    for _ in range(3):
        asked.hears(own_target())
    assert asked.ask(HOLD, GUIDED)[-1] == IN_PROGRESS
    asked.live(1.0)
    assert asked.board.mode_now == GUIDED


def test_a_hold_that_crosses_the_take_over_or_the_way_back_is_set_all_the_same() -> None:
    asked = Guiding()
    asked.streams = True
    asked.send(GUIDED, AUTO, hold=GUIDE)
    assert asked.ask(HOLD, AUTO) == [IN_PROGRESS, ACCEPTED, IN_PROGRESS]
    asked = Guiding().guided()
    asked.send(AUTO, GUIDED, hold=GUIDE)
    assert asked.ask(HOLD, GUIDED) == [ACCEPTED, ACCEPTED, IN_PROGRESS]


def test_but_not_a_second_later_nor_over_a_human_s_auto() -> None:
    asked = Guiding().guided()
    asked.live(1.0)
    assert asked.ask(HOLD, AUTO) == [CHANGED]
    assert asked.ask(AUTO, GUIDED, hold=GUIDE)[-1] == ACCEPTED
    asked.live(1.0)
    assert asked.ask(HOLD, GUIDED) == [CHANGED]
    asked = Guiding().guided()
    asked.board.human_sets(AUTO)
    assert asked.ask(HOLD, GUIDED)[-1] == CHANGED
    assert asked.shows == (AUTO, BY_GCS)


@pytest.mark.parametrize("reason", [BY_GCS, BY_RC])
@pytest.mark.parametrize("mode", [MANUAL, AUTO, RTL, HOLD, GUIDED, 5])
def test_a_human_s_mode_while_it_guides_takes_over(mode: int, reason: int) -> None:
    asked = Guiding().guided()
    if mode == GUIDED:
        asked.board.human_sets(MANUAL, reason)
    asked.board.human_sets(mode, reason)
    assert asked.answers() == [(asked.serial, CHANGED)]
    asked.streams = False
    asked.live(OVER)
    assert asked.shows == (mode, reason)
    assert asked.set_modes == []


@pytest.mark.parametrize("streams", [False, True])
@pytest.mark.parametrize("command", COMMANDS)
def test_so_does_a_target_or_a_guided_that_another_commands(
    command: Callable[[], Any], streams: bool
) -> None:
    asked = Guiding().guided()
    assert asked.answers(lambda: asked.hears(command(), STATION)) == [(asked.serial, CHANGED)]
    asked.streams = streams
    assert asked.ask(AUTO, GUIDED, hold=GUIDE) == [CHANGED]
    assert asked.ask(HOLD, GUIDED) == [CHANGED], "it may have been asked for before that"
    asked.live(OVER)
    assert asked.shows == (GUIDED, SCRIPTING)
    last = asked.set_modes[-2:], len(asked.set_modes) // 2
    assert last == ([HOLD, GUIDED], 5 if streams else 1), "a target of the companion's replaced theirs"
    assert asked.board.texts(4).count("GUIDED is yours: send the target again") == 1
    assert asked.ask(HOLD, GUIDED) == [ACCEPTED], "a GUIDED of a human's is held out of, as ever"


def test_a_target_that_none_of_the_companion_s_has_replaced_is_left_as_it_is() -> None:
    asked = Guiding().guided()
    asked.streams = False
    assert asked.answers(lambda: asked.hears(COMMANDS[0](), STATION)) == [(asked.serial, CHANGED)]
    asked.live(0.6)
    asked.streams = True
    asked.live(OVER)
    assert asked.set_modes == []


def test_one_that_comes_in_the_cycle_of_the_way_back_or_of_a_hold_takes_over() -> None:
    for mode, hold in ((AUTO, GUIDE), (HOLD, 7)):
        asked = Guiding().guided()
        asked.send(mode, GUIDED, hold=hold)
        assert [result for _, result in asked.answers(lambda a=asked: a.hears(set_guided(), STATION))] == [  # type: ignore[misc]
            CHANGED,
            CHANGED,
        ]
        asked.streams = False
        asked.live(OVER)
        assert asked.shows == (GUIDED, SCRIPTING)


@pytest.mark.parametrize("command", COMMANDS)
def test_one_that_is_damaged_or_for_another_vehicle_does_not(command: Callable[..., Any]) -> None:
    for system in (1, 2):
        asked = Guiding().guided()
        frame = bytearray(command(system).pack(STATION))
        frame[-1] ^= system == 1
        asked.board.hear(frame)
        asked.live(2.0)
        assert asked.ask(HOLD, GUIDED)[-1] == IN_PROGRESS


def test_the_companion_s_own_hold_past_the_script_is_its_own() -> None:
    asked = Guiding().guided()
    taken = asked.serial
    command = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, HOLD, 0, 0, 0, 0, 9)
    asked.hears(command)
    asked.board.human_sets(HOLD, BY_GCS)
    assert asked.answers() == [(taken, ACCEPTED)]
    assert asked.ask(AUTO, HOLD, hold=9) == [ACCEPTED]


@pytest.mark.parametrize("which", [1, 2, 3])
@pytest.mark.parametrize("mode", [MANUAL, RTL, AUTO])
def test_a_human_who_sets_a_mode_between_any_two_steps_of_a_hold_keeps_it(which: int, mode: int) -> None:
    asked = Guiding().guided()
    asked.streams = False
    asked.board.meet(lambda: asked.board.human_sets(mode, BY_RC), which)
    results = asked.ask(HOLD, GUIDED)
    asked.live(OVER)
    if which == 2:  # between a comparison and the call beside it nothing can be noticed
        assert asked.board.mode_now == HOLD
        return
    assert asked.shows == (mode, BY_RC)
    assert CHANGED in results


def test_a_human_s_hold_between_the_two_steps_is_not_resumed_out_of() -> None:
    asked = Guiding().guided()
    asked.streams = False
    hold = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, HOLD, 0, 0, 0, 0, 0)
    asked.board.meet(lambda: asked.hears(hold, STATION), 2)
    assert asked.ask(HOLD, GUIDED)[-1] == IN_PROGRESS
    asked.live(OVER)
    assert asked.board.mode_now == HOLD
    assert asked.ask(AUTO, HOLD) == [DENIED]


@pytest.mark.parametrize("which", range(4))
def test_a_human_who_sets_a_mode_while_it_is_stopped_for_want_of_targets_keeps_it(which: int) -> None:
    asked = Guiding().guided()
    asked.streams = False
    asked.board.meet(lambda: asked.board.human_sets(MANUAL, BY_RC), which)
    asked.live(OVER)
    assert asked.board.mode_now == (MANUAL if which in (1, 3) else HOLD)
