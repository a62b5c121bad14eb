"""The script sets a mode for the companion only where the mode that the companion expects still stands."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

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
    driving,
)

ACCEPTED, CHANGED, DENIED, FAILED = 0, 1, 2, 4
STATION = mavlink.MAVLink(None, 255, 190)


class Requests:
    """A board in AUTO, and the companion that asks its script for modes."""

    def __init__(self, *, guards: bool = True) -> None:
        self.board = driving(ATS_ENABLE=float(guards))
        self.serial = 100

    def send(
        self, mode: float, expected: float, *, hold: float = 7, serial: float | None = None, mav: Any = None
    ) -> None:
        """A request arrives."""
        self.serial += 1
        number = self.serial if serial is None else serial
        self.command(MODE_REQUEST_COMMAND, hold, expected, mode, number, mav=mav)

    def command(self, number: int, *parameters: float, seventh: float = 0, mav: Any = None) -> None:
        """A COMMAND_LONG arrives."""
        first = (*parameters, *[0.0] * (6 - len(parameters)))
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *first, seventh)
        self.board.hear(message.pack(mav or self.board.companion))

    def ask(self, mode: float, expected: float, **how: Any) -> list[int]:
        """A request arrives, and a cycle goes by. Returns the results that were answered."""
        before = len(self.board.sent)
        self.send(mode, expected, **how)
        self.board.beat()
        self.board.pass_time(CYCLE)
        return [struct.unpack_from("<HB", payload)[1] for _, _, payload in self.board.sent[before:]]

    def station_sets_hold(self, *, message: str = "COMMAND_LONG", target: int = 1, mav: Any = None) -> None:
        """A ground station commands HOLD; the autopilot obeys at once."""
        if message == "COMMAND_INT":
            command = mavlink.MAVLink_command_int_message(target, 1, 0, 176, 0, 0, 1, HOLD, 0, 0, 0, 0, 0)
            self.board.hear(command.pack(mav or STATION))
        elif message == "SET_MODE":
            self.board.hear(mavlink.MAVLink_set_mode_message(target, 1, HOLD).pack(mav or STATION))
        else:
            self.command(176, 1, HOLD, mav=mav or STATION)
        if self.board.mode_now != HOLD:
            self.board.human_sets(HOLD)

    def held(self) -> Requests:
        """The companion's hold 7 stands."""
        assert self.ask(HOLD, AUTO) == [ACCEPTED]
        assert self.board.mode_now == HOLD
        return self

    def wait(self, seconds: float = 0.3) -> None:
        """Time goes by with a companion that is well."""
        self.board.pass_time(seconds, state=State.OK)


def test_a_hold_and_a_resume_are_set_and_answered_to_who_asked() -> None:
    asked = Requests().held()
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]
    assert asked.board.mode_now == AUTO
    channel, message, payload = asked.board.sent[-1]
    assert (channel, message) == (0, mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
    assert struct.unpack("<HBBiBB", payload) == (MODE_REQUEST_COMMAND, ACCEPTED, 0, asked.serial, 1, 191)


def test_guided_is_resumed_too_and_no_other_mode_is_set() -> None:
    asked = Requests().held()
    for mode in (MANUAL, RTL, 5, 6, 99, 255):
        assert asked.ask(mode, HOLD) == [FAILED]
    assert asked.board.mode_now == HOLD
    assert asked.ask(GUIDED, HOLD) == [ACCEPTED]
    assert asked.board.mode_now == GUIDED


def test_the_question_whether_it_is_there_changes_nothing() -> None:
    asked = Requests()
    assert asked.ask(0, 0, hold=0) == [ACCEPTED]
    assert asked.ask(AUTO, HOLD, hold=0) == [ACCEPTED]
    assert asked.board.set_modes == []


def test_its_command_is_blocked_for_the_autopilot_s_own_handler() -> None:
    assert driving().scripting.blocked == {MODE_REQUEST_COMMAND}


@pytest.mark.parametrize("mode", [MANUAL, RTL, GUIDED, 5])
def test_a_hold_over_another_mode_than_the_expected_one_is_not_set(mode: int) -> None:
    asked = Requests()
    asked.board.human_sets(mode)
    assert asked.ask(HOLD, AUTO) == [CHANGED]
    assert asked.board.mode_now == mode


@pytest.mark.parametrize("mode", [MANUAL, RTL, GUIDED, AUTO, 5])
def test_a_resume_over_a_human_s_mode_is_not_set(mode: int) -> None:
    asked = Requests().held()
    asked.board.human_sets(mode)
    assert asked.ask(AUTO, HOLD) in ([CHANGED], [FAILED])
    assert asked.board.mode_now == mode


def test_nor_after_a_human_s_mode_that_lasted_less_than_a_cycle() -> None:
    asked = Requests().held()
    asked.board.human_sets(HOLD, BY_RC)  # MANUAL, and HOLD again
    assert asked.ask(AUTO, HOLD) == [DENIED]
    assert asked.board.mode_now == HOLD


@pytest.mark.parametrize("message", ["COMMAND_LONG", "COMMAND_INT", "SET_MODE"])
@pytest.mark.parametrize("station", [(255, 190), (1, 190), (254, 1)])
def test_nor_out_of_a_hold_that_a_human_pressed_within_ours(message: str, station: tuple[int, int]) -> None:
    asked = Requests().held()
    asked.station_sets_hold(message=message, mav=mavlink.MAVLink(None, *station))
    asked.wait()
    assert asked.ask(AUTO, HOLD) == [DENIED]
    assert asked.board.mode_now == HOLD


def test_not_even_where_the_press_and_the_request_come_in_one_cycle() -> None:
    asked = Requests().held()
    asked.station_sets_hold()
    assert asked.ask(AUTO, HOLD) == [DENIED]


def test_nor_where_the_press_comes_after_the_request_in_one_cycle() -> None:
    asked = Requests().held()
    asked.send(AUTO, HOLD)
    asked.station_sets_hold()
    asked.wait()
    assert asked.board.mode_now == HOLD
    assert struct.unpack_from("<HB", asked.board.sent[-1][2])[1] == DENIED


def test_a_press_with_a_wrong_checksum_or_for_another_vehicle_is_none() -> None:
    asked = Requests().held()
    message = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, HOLD, 0, 0, 0, 0, 0)
    frame = bytearray(message.pack(STATION))
    frame[-1] ^= 1
    asked.board.hear(bytes(frame))
    asked.station_sets_hold(message="SET_MODE", target=2)
    asked.wait()
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_another_mode_that_a_ground_station_commands_is_no_press() -> None:
    asked = Requests().held()
    asked.command(176, 1, MANUAL, mav=STATION)  # the autopilot refuses it
    asked.wait()
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_a_press_counts_no_more_when_the_hold_was_left() -> None:
    asked = Requests()
    asked.station_sets_hold()
    asked.wait()
    asked.board.human_sets(AUTO)
    asked.wait()
    asked.held()
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_a_human_s_hold_is_not_taken_for_the_companion_s() -> None:
    asked = Requests()
    asked.station_sets_hold()
    asked.wait()
    assert asked.ask(HOLD, AUTO) == [CHANGED]
    assert asked.ask(AUTO, HOLD) == [FAILED]


def test_a_human_who_is_faster_than_the_script_keeps_the_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Requests()

    def too_late(number: int) -> bool:
        asked.board.human_sets(number, BY_RC)
        return True

    monkeypatch.setattr(asked.board, "set_mode", too_late)
    asked.board.scripting.restart()
    asked.wait()
    assert asked.ask(HOLD, AUTO) == [CHANGED]
    assert asked.ask(AUTO, HOLD) == [FAILED]


def test_a_resume_names_the_hold_that_stands() -> None:
    asked = Requests().held()
    assert asked.ask(AUTO, HOLD, hold=8) == [FAILED]
    assert asked.ask(AUTO, HOLD, hold=7) == [ACCEPTED]


def test_a_second_hold_of_another_id_joins_the_first() -> None:
    asked = Requests().held()
    assert asked.ask(HOLD, AUTO, hold=8) == [ACCEPTED]
    assert asked.ask(AUTO, HOLD, hold=8) == [ACCEPTED]


def test_each_serial_number_counts_once_and_is_answered_each_time() -> None:
    asked = Requests().held()
    assert asked.ask(AUTO, HOLD, serial=500) == [ACCEPTED]
    asked.held()
    assert asked.ask(AUTO, HOLD, serial=500) == [ACCEPTED]
    assert asked.board.mode_now == HOLD, "it was set once"


def test_a_request_that_waited_for_more_than_a_second_is_no_more() -> None:
    asked = Requests().held()
    asked.send(AUTO, HOLD)
    asked.board.ms += 1100
    asked.board.beat()
    asked.board.pass_time(0.5)
    assert asked.board.mode_now == HOLD


def test_nobody_but_the_companion_asks() -> None:
    for ids in ((255, 190), (1, 190), (2, 191)):
        asked = Requests()
        assert asked.ask(HOLD, AUTO, mav=mavlink.MAVLink(None, *ids)) == []
        assert asked.board.mode_now == AUTO


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -1.0, 1e9, 0.0])
def test_numbers_that_are_none_are_ignored(bad: float) -> None:
    asked = Requests()
    assert asked.ask(HOLD, AUTO, serial=bad) == []
    assert asked.board.texts(3) == []


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -1.0, 1e9])
def test_and_so_are_modes_that_are_none(bad: float) -> None:
    asked = Requests()
    assert asked.ask(bad, AUTO) == []
    assert asked.board.set_modes == []
    assert asked.board.texts(3) == []


def test_a_disarmed_rover_is_not_driven_off() -> None:
    asked = Requests().held()
    asked.board.armed = False
    assert asked.ask(AUTO, HOLD) == [FAILED]


def test_it_sets_modes_even_where_the_guard_is_switched_off() -> None:
    asked = Requests(guards=False).held()
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_a_hold_that_the_companion_set_past_the_script_is_resumed_by_its_id() -> None:
    asked = Requests()
    asked.command(176, 1, HOLD, seventh=9)
    asked.board.human_sets(HOLD, BY_GCS)
    asked.wait()
    assert asked.ask(AUTO, HOLD, hold=7) == [FAILED]
    assert asked.ask(AUTO, HOLD, hold=9) == [ACCEPTED]


def test_but_not_where_a_human_commanded_hold_as_well() -> None:
    for first in ("companion", "station"):
        asked = Requests()
        if first == "station":
            asked.station_sets_hold()
        asked.command(176, 1, HOLD, seventh=9)
        asked.station_sets_hold()
        asked.wait()
        assert asked.ask(AUTO, HOLD, hold=9) in ([DENIED], [FAILED])
        assert asked.board.mode_now == HOLD


def test_after_a_restart_of_scripting_it_knows_no_hold() -> None:
    asked = Requests().held()
    asked.board.scripting.restart()
    asked.wait()
    assert asked.ask(AUTO, HOLD) == [FAILED]
    assert asked.board.mode_now == HOLD


def test_the_script_s_own_hold_for_a_fault_becomes_the_companion_s() -> None:
    asked = Requests()
    asked.board.pass_time(0.5, state=State.FAULT)
    assert asked.board.mode_now == HOLD
    assert asked.ask(HOLD, AUTO) == [ACCEPTED]
    asked.wait(1.0)
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


def test_and_so_it_does_where_the_companion_s_own_request_was_lost() -> None:
    asked = Requests()
    asked.board.pass_time(2.0)
    assert asked.board.texts(2)[-1].startswith("HOLD: companion silent")
    asked.wait(1.0)
    assert asked.ask(AUTO, HOLD) == [ACCEPTED]


class Faulty:
    """A companion that reports a fault, and whether a human drives on in spite of it."""

    def __init__(self) -> None:
        self.board = driving()
        self.accepted = False
        self.board.mode_now, self.board.reason = HOLD, BY_GCS
        self.live(1.0)

    def live(self, seconds: float) -> None:
        """Time goes by, with a heartbeat every half second."""
        for step in range(round(seconds / CYCLE)):
            if step % 5 == 0:
                mode = heartbeat_mode(State.FAULT, 7, self.board.policy, self.accepted)
                beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3)
                self.board.hear(beat.pack(self.board.companion))
            self.board.pass_time(CYCLE)


def test_a_human_who_drives_on_is_held_for_the_fault_unless_the_companion_says_that_it_is_accepted() -> None:
    faulty = Faulty()
    faulty.board.human_sets(AUTO)
    faulty.live(0.4)
    assert faulty.board.mode_now == AUTO, "the companion has not had its say"
    faulty.live(0.6)
    assert faulty.board.mode_now == HOLD


def test_an_accepted_fault_holds_nobody_until_it_is_accepted_no_more() -> None:
    faulty = Faulty()
    faulty.board.human_sets(AUTO)
    faulty.accepted = True
    faulty.live(20.0)
    assert faulty.board.mode_now == AUTO
    faulty.accepted = False
    faulty.live(0.6)
    assert faulty.board.mode_now == HOLD


def test_silence_counts_even_then() -> None:
    faulty = Faulty()
    faulty.board.human_sets(AUTO)
    faulty.accepted = True
    faulty.live(5.0)
    faulty.board.pass_time(2.0)
    assert faulty.board.mode_now == HOLD


def test_a_fault_that_begins_while_it_drives_is_held_at_once() -> None:
    board = driving()
    board.pass_time(2.0, state=State.OK)
    board.beat(State.FAULT)
    board.pass_time(2 * CYCLE)
    assert board.mode_now == HOLD


MODES = st.sampled_from([MANUAL, HOLD, AUTO, RTL, GUIDED])
STEPS = st.one_of(
    st.tuples(st.just("human"), MODES, st.sampled_from([BY_GCS, BY_RC])),
    st.tuples(st.just("ask"), st.sampled_from([HOLD, AUTO, GUIDED]), MODES),
    st.tuples(st.just("press"), st.just(HOLD), st.just(0)),
    st.tuples(st.just("time"), st.just(0), st.just(0)),
)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.lists(STEPS, max_size=25))
def test_whatever_happens_it_never_changes_a_mode_that_a_human_set_last(
    steps: list[tuple[str, int, int]],
) -> None:
    asked = Requests()
    board = asked.board
    human: int | None = None
    for kind, mode, more in steps:
        if kind == "human" and mode != board.mode_now:
            board.human_sets(mode, more)
            human = mode
        elif kind == "press":
            pressed_within = board.mode_now == HOLD
            asked.station_sets_hold()
            human = HOLD
            assert pressed_within or board.reason == BY_GCS
        elif kind == "ask":
            expected = board.mode_now if more == board.mode_now else more
            asked.send(mode, expected)
        before = board.mode_now
        board.beat()
        board.pass_time(CYCLE)
        if board.mode_now != before:
            assert human is None or before in (AUTO, GUIDED), (before, board.mode_now)
            human = None
