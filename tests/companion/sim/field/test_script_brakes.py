"""The script brakes in GUIDED before it sets HOLD, and whoever commands meanwhile has the rover."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import scripting
from companion.wire.ids import MODE_REQUEST_COMMAND, State, heartbeat_mode
from tests.companion.sim.field.stubs import (
    AUTO,
    BY_GCS,
    BY_RC,
    CYCLE,
    GUIDED,
    HOLD,
    MANUAL,
    RTL,
    SCRIPTING,
    SOURCE,
    Board,
    driving,
)

pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")

ACCEPTED, CHANGED, FAILED, IN_PROGRESS = 0, 1, 4, 5
STATION: Any = mavlink.MAVLink(None, 255, 190)
LONGEST = 4.0
LIMIT = LONGEST + 2 * CYCLE


def local_target(system: int = 1) -> Any:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, system, 1, 1, 0xDC7, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0
    )


def global_target(system: int = 1) -> Any:
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, system, 1, 6, 0xDF8, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )


def attitude_target(system: int = 1) -> Any:
    return mavlink.MAVLink_set_attitude_target_message(0, system, 1, 0, [1, 0, 0, 0], 0, 0, 1, 0.5)


def item(system: int = 1, current: int = 2) -> Any:
    return mavlink.MAVLink_mission_item_int_message(system, 1, 0, 3, 16, current, 1, 0, 0, 0, 0, 1, 1, 0)


def old_item(system: int = 1) -> Any:
    return mavlink.MAVLink_mission_item_message(system, 1, 0, 3, 16, 2, 1, 0, 0, 0, 0, 1, 1, 0)


def reposition(system: int = 1) -> Any:
    return mavlink.MAVLink_command_int_message(system, 1, 3, 192, 0, 0, -1, 0, 0, 0, 1, 1, 0)


def yaw_speed(system: int = 1) -> Any:
    return mavlink.MAVLink_command_long_message(system, 1, 213, 0, 0, 1, 0, 0, 0, 0, 0)


def set_guided(system: int = 1) -> Any:
    return mavlink.MAVLink_command_long_message(system, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0)


def old_set_guided(system: int = 1) -> Any:
    return mavlink.MAVLink_set_mode_message(system, 1, GUIDED)


TARGETS = [local_target, global_target, attitude_target, item, old_item, reposition, yaw_speed]
COMMANDS = [*TARGETS, set_guided, old_set_guided]


class Braking:
    """A board in AUTO, whose companion has told that it brakes for `seconds` at most."""

    def __init__(self, seconds: float = LONGEST, **parameters: Any) -> None:
        self.board = driving(**parameters)
        self.seconds, self.serial = seconds, 100
        self.live(2.0)
        self.ask(0, 0, hold=0)

    def ask(self, mode: float, expected: float, *, hold: float = 7, serial: float | None = None) -> list[int]:
        """A request arrives, and a cycle goes by. Returns the results that were answered."""
        self.serial += 1
        number = self.serial if serial is None else serial
        message = mavlink.MAVLink_command_long_message(
            1, 1, MODE_REQUEST_COMMAND, 0, hold, expected, mode, number, self.seconds, 0, 0
        )
        return self.answers(lambda: self.board.hear(message.pack(self.board.companion)))

    def answers(self, do: Callable[[], None] = lambda: None, seconds: float = CYCLE) -> list[int]:
        """Returns the results that the script answers while something happens, and time goes by."""
        before = len(self.board.sent)
        do()
        self.live(seconds)
        return [struct.unpack_from("<HB", payload)[1] for _, _, payload in self.board.sent[before:]]

    def live(self, seconds: float, state: State = State.OK) -> None:
        """Time goes by with a companion that lives."""
        for _ in range(round(seconds / CYCLE)):
            self.board.beat(state)
            self.board.pass_time(CYCLE)

    def brakes(self) -> Braking:
        """It brakes for the companion's hold 7."""
        assert self.ask(HOLD, AUTO) == [IN_PROGRESS]
        assert (self.board.mode_now, self.board.reason) == (GUIDED, SCRIPTING)
        return self

    def sends(self, message: Any, mav: Any = STATION) -> Callable[[], None]:
        return lambda: self.board.hear(message.pack(mav))


def test_a_hold_brakes_in_guided_and_holds_once_the_rover_stands() -> None:
    asked = Braking().brakes()
    assert asked.answers(seconds=1.0) == []
    asked.board.moves_at = 0.09
    assert asked.answers() == [ACCEPTED]
    assert asked.board.mode_now == HOLD
    assert [mode for _, mode, _, _ in asked.board.set_modes] == [GUIDED, HOLD]
    assert struct.unpack("<HBBiBB", asked.board.sent[-1][2])[3] == asked.serial
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


@pytest.mark.parametrize(("told", "limit"), [(0.5, 0.5), (2.0, 2.0), (4.0, 4.0), (60.0, 4.0), (1e30, 4.0)])
def test_it_brakes_for_the_time_that_was_told_and_four_seconds_at_most(told: float, limit: float) -> None:
    asked = Braking(told).brakes()
    asked.live(limit - 2 * CYCLE)
    assert asked.board.mode_now == GUIDED
    asked.live(2 * CYCLE)
    assert asked.board.mode_now == HOLD


@pytest.mark.parametrize("told", [0.0, -1.0, float("nan")])
def test_where_no_time_was_told_it_holds_at_once(told: float) -> None:
    asked = Braking(told)
    assert asked.ask(HOLD, AUTO) == [ACCEPTED]
    assert [mode for _, mode, _, _ in asked.board.set_modes] == [HOLD]


def test_so_it_does_out_of_guided_for_a_boat_and_where_the_rover_stands() -> None:
    asked = Braking()
    asked.board.human_sets(GUIDED)
    assert asked.ask(HOLD, GUIDED) == [ACCEPTED]
    assert Braking(FRAME_CLASS=2.0).ask(HOLD, AUTO) == [ACCEPTED]
    for speed in (0.0, 0.05, float("nan")):
        asked = Braking()
        asked.board.moves_at = speed
        assert asked.ask(HOLD, AUTO) == [ACCEPTED]
        assert asked.board.mode_now == HOLD


def test_and_where_the_speed_cannot_be_read_or_no_place_is_left_to_hear_targets() -> None:
    asked = Braking()
    asked.board.broken.add("speed")
    assert asked.ask(HOLD, AUTO) == [ACCEPTED]
    asked = Braking()
    asked.board.scripting.open_queue(10, 5)
    asked.live(CYCLE)
    assert asked.ask(HOLD, AUTO) == [ACCEPTED]


def test_what_was_commanded_before_the_script_ran_is_not_known_for_5_s() -> None:
    for seconds, result in ((4.5, ACCEPTED), (5.5, IN_PROGRESS)):
        asked = Braking()
        asked.board.scripting.restart()
        asked.live(seconds)
        assert asked.ask(HOLD, AUTO) == [result]


def test_a_speed_that_is_lost_on_the_way_ends_in_hold() -> None:
    asked = Braking().brakes()
    asked.board.broken.add("speed")
    assert asked.answers() == [ACCEPTED]
    assert asked.board.mode_now == HOLD


def test_and_where_guided_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Braking()
    may = asked.board.set_mode
    monkeypatch.setattr(asked.board, "set_mode", lambda number: number != GUIDED and may(number))
    asked.board.scripting.restart()
    asked.live(5.2)
    assert asked.ask(HOLD, AUTO) == [ACCEPTED]
    assert asked.board.mode_now == HOLD


def test_a_human_who_is_faster_than_the_brake_keeps_the_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    for mode in (GUIDED, MANUAL):
        asked = Braking()

        def too_late(_number: int, board: Board = asked.board, mode: int = mode) -> bool:
            board.human_sets(mode, BY_RC)
            return True

        monkeypatch.setattr(asked.board, "set_mode", too_late)
        asked.board.scripting.restart()
        asked.live(5.2)
        assert asked.ask(HOLD, AUTO) == [CHANGED]
        asked.live(LIMIT)
        assert asked.board.mode_now == mode


@pytest.mark.parametrize("mode", [MANUAL, AUTO, RTL, HOLD, GUIDED, 5])
@pytest.mark.parametrize("reason", [BY_GCS, BY_RC])
def test_a_human_s_mode_during_the_brake_stays(mode: int, reason: int) -> None:
    asked = Braking().brakes()
    asked.board.human_sets(mode, reason)
    assert asked.answers() == [CHANGED]
    asked.live(LIMIT)
    assert (asked.board.mode_now, asked.board.reason) == (mode, reason)
    assert asked.ask(AUTO, HOLD) in ([CHANGED], [FAILED])


@pytest.mark.parametrize("command", COMMANDS)
def test_a_target_or_a_mode_that_another_commands_during_the_brake_takes_over(
    command: Callable[[], Any],
) -> None:
    asked = Braking().brakes()
    assert asked.answers(asked.sends(command())) == [CHANGED]
    asked.live(LIMIT)
    assert asked.board.mode_now == GUIDED
    assert asked.ask(HOLD, AUTO) == [CHANGED]


@pytest.mark.parametrize("mode", [99, RTL])
def test_another_mode_that_is_commanded_and_refused_leaves_the_brake_alone(mode: int) -> None:
    asked = Braking().brakes()
    command = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0
    )
    assert asked.answers(asked.sends(command)) == []
    asked.board.pass_time(LIMIT)
    assert asked.board.mode_now == HOLD


def test_a_human_s_hold_that_is_commanded_during_the_brake_is_not_resumed_out_of() -> None:
    asked = Braking().brakes()
    command = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, HOLD, 0, 0, 0, 0, 0
    )
    asked.answers(asked.sends(command), 0.0)
    asked.board.human_sets(HOLD, BY_GCS)
    asked.live(LIMIT)
    assert asked.ask(AUTO, HOLD) == [FAILED]
    assert asked.board.mode_now == HOLD


@pytest.mark.parametrize("command", COMMANDS)
def test_one_that_is_damaged_for_another_vehicle_or_the_companion_s_own_does_not(
    command: Callable[..., Any],
) -> None:
    for wrong in ("damaged", "another", "own"):
        asked = Braking().brakes()
        frame = bytearray(command(2 if wrong == "another" else 1).pack(STATION))
        if wrong == "damaged":
            frame[-1] ^= 1
        if wrong == "own":
            frame = bytearray(command().pack(asked.board.companion))
        asked.board.hear(frame)
        asked.live(LIMIT)
        assert asked.board.mode_now == HOLD


@pytest.mark.parametrize("command", TARGETS)
def test_where_a_target_of_another_was_seen_in_the_last_5_s_it_holds_at_once(
    command: Callable[[], Any],
) -> None:
    for seconds, result in ((4.5, ACCEPTED), (5.5, IN_PROGRESS)):
        asked = Braking()
        asked.board.hear(command().pack(STATION))
        asked.live(seconds)
        assert asked.ask(HOLD, AUTO) == [result]


def test_the_upload_of_a_mission_is_no_target() -> None:
    asked = Braking()
    asked.board.hear(item(current=0).pack(STATION))
    asked.live(CYCLE)
    asked.brakes()
    asked.board.hear(item(current=0).pack(STATION))
    asked.live(LIMIT)
    assert asked.board.mode_now == HOLD


def test_a_request_that_comes_again_is_answered_and_does_not_prolong_the_brake() -> None:
    asked = Braking(1.0).brakes()
    for _ in range(8):
        assert asked.ask(HOLD, AUTO) == [IN_PROGRESS]
    assert asked.answers(seconds=2 * CYCLE) == [ACCEPTED]
    assert asked.board.mode_now == HOLD


def test_each_serial_number_brakes_once() -> None:
    asked = Braking(1.0).brakes()
    number = float(asked.serial)
    assert asked.ask(HOLD, AUTO, serial=number) == [IN_PROGRESS]
    asked.live(1.0)
    asked.board.human_sets(AUTO)
    asked.live(CYCLE)
    assert asked.ask(HOLD, AUTO, serial=number) == [ACCEPTED]
    assert asked.board.mode_now == AUTO


def test_a_request_that_tells_no_time_to_brake_ends_it_in_hold() -> None:
    asked = Braking().brakes()
    asked.seconds = 0.0
    assert asked.ask(HOLD, AUTO, hold=8) == [IN_PROGRESS, ACCEPTED]
    assert asked.board.mode_now == HOLD
    assert asked.ask(AUTO, HOLD, hold=8) == [ACCEPTED]


def test_a_go_during_the_brake_resumes_nothing() -> None:
    asked = Braking().brakes()
    assert asked.ask(AUTO, HOLD) == [FAILED]
    assert asked.board.mode_now == GUIDED
    asked.live(LIMIT)
    assert asked.board.mode_now == HOLD


def test_a_rover_that_is_disarmed_during_the_brake_is_in_hold() -> None:
    asked = Braking().brakes()
    asked.board.armed = False
    asked.live(CYCLE)
    assert asked.board.mode_now == HOLD


def test_a_hold_that_is_refused_at_the_end_is_tried_again() -> None:
    asked = Braking(0.5).brakes()
    asked.board.obeys = False
    asked.live(1.0)
    assert asked.board.mode_now == GUIDED
    asked.board.obeys = True
    assert asked.answers() == [ACCEPTED]
    assert asked.board.mode_now == HOLD


@pytest.mark.parametrize("guards", [0.0, 1.0])
def test_a_companion_that_dies_during_the_brake_is_held_all_the_same(guards: float) -> None:
    asked = Braking(ATS_ENABLE=guards).brakes()
    asked.board.pass_time(LIMIT)
    assert asked.board.mode_now == HOLD


def test_a_dead_companion_is_braked_for_by_the_time_that_it_told_last() -> None:
    asked = Braking(2.0)
    asked.board.pass_time(1.7)
    assert asked.board.mode_now == GUIDED
    assert asked.board.texts(2)[-1] == "Braking: companion silent"
    asked.board.pass_time(2.2)
    assert asked.board.mode_now == HOLD
    assert asked.board.texts(2)[-1] == "HOLD: companion silent. AUTO again = go blind"
    asked.board.human_sets(AUTO)
    asked.board.pass_time(20.0)
    assert asked.board.mode_now == AUTO


@pytest.mark.parametrize("command", COMMANDS)
def test_a_human_who_takes_over_that_brake_goes_blind(command: Callable[[], Any]) -> None:
    asked = Braking()
    asked.board.pass_time(2.0)
    asked.board.hear(command().pack(STATION))
    asked.board.pass_time(20.0)
    assert asked.board.mode_now == GUIDED
    assert asked.board.texts(4)[-1] == "GUIDED without companion: send target again"


def test_who_takes_over_the_brake_for_a_fault_is_held_unless_the_companion_accepts_that() -> None:
    for accepts in (False, True):
        asked = Braking().brakes()
        asked.live(0.5, State.FAULT)
        assert asked.board.mode_now == GUIDED, "the script does not interfere"
        asked.board.hear(local_target().pack(STATION))
        for _ in range(10):
            mode = heartbeat_mode(State.FAULT, 7, asked.board.policy, accepts)
            asked.board.hear(
                mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3).pack(asked.board.companion)
            )
            asked.board.pass_time(CYCLE)
        assert asked.board.mode_now == (GUIDED if accepts else HOLD)


def test_the_companion_joins_the_brake_that_was_begun_for_its_fault() -> None:
    asked = Braking()
    asked.live(2 * CYCLE, State.FAULT)
    assert asked.board.mode_now == GUIDED
    assert asked.ask(HOLD, AUTO) == [IN_PROGRESS]
    asked.live(LIMIT)
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_a_script_that_is_started_anew_during_the_brake_claims_nothing() -> None:
    asked = Braking().brakes()
    asked.board.scripting.restart()
    asked.live(CYCLE)
    assert asked.ask(HOLD, AUTO) == [CHANGED]
    asked.live(LIMIT)
    assert asked.board.mode_now == GUIDED


def test_a_flood_of_targets_stays_within_the_instructions_that_scripts_are_given() -> None:
    board = driving()
    board.scripting = scripting.Scripting(SOURCE, "anytraverse.lua", board)
    damaged = bytearray(local_target().pack(STATION))
    damaged[-1] ^= 1
    for cycle in range(30):
        board.beat()
        if cycle == 5:
            request = mavlink.MAVLink_command_long_message(1, 1, 31014, 0, 7, AUTO, HOLD, 9, 4, 0, 0)
            board.hear(request.pack(board.companion))
        for _ in range(25 if cycle > 5 else 0):
            board.hear(damaged)
        board.pass_time(CYCLE)
    assert board.scripting.ended == ""
    assert board.mode_now in (GUIDED, HOLD)


STEPS = st.one_of(
    st.tuples(st.just("human"), st.sampled_from([MANUAL, HOLD, AUTO, RTL, GUIDED]), st.sampled_from([1, 2])),
    st.tuples(st.just("command"), st.integers(0, len(COMMANDS) - 1), st.just(0)),
    st.tuples(st.just("ask"), st.sampled_from([HOLD, AUTO, GUIDED]), st.sampled_from([AUTO, GUIDED, HOLD])),
    st.tuples(st.just("speed"), st.sampled_from([0, 1]), st.just(0)),
    st.tuples(st.just("seconds"), st.sampled_from([0, 1, 4]), st.just(0)),
    st.tuples(st.just("time"), st.sampled_from([1, 5, 20]), st.just(0)),
    st.tuples(st.just("silence"), st.sampled_from([5, 20, 50]), st.just(0)),
    st.tuples(st.just("fault"), st.sampled_from([1, 5]), st.just(0)),
)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.lists(STEPS, max_size=25))
def test_whatever_happens_guided_is_a_human_s_or_over_in_time_and_a_human_s_mode_stays(
    steps: list[tuple[str, int, int]],
) -> None:
    asked = Braking()
    board = asked.board
    human = braked = False
    for kind, value, more in steps:
        if kind == "human" and value != board.mode_now:
            board.human_sets(value, more)
            human = value not in (AUTO, GUIDED)
            braked = False
        elif kind == "command":
            board.hear(COMMANDS[value]().pack(STATION))
            braked = False
        elif kind == "ask":
            before = board.mode_now
            asked.ask(value, more)
            braked |= before == AUTO and board.mode_now == GUIDED
            # A resume is ours, and so is what it sets.
            human &= board.mode_now == before
        elif kind == "speed":
            board.moves_at = float(value)
        elif kind == "seconds":
            asked.seconds = float(value)
        stood = board.mode_now
        if kind == "silence":
            board.pass_time(value * CYCLE)
        else:
            asked.live(
                value * CYCLE if kind in ("time", "fault") else CYCLE,
                State.FAULT if kind == "fault" else State.OK,
            )
        assert not human or board.mode_now == stood
    if braked:
        asked.live(LIMIT)
        assert board.mode_now != GUIDED
    assert board.scripting.ended == ""
