"""Mode commands: as requests to the script on the autopilot where it was heard, else as DO_SET_MODE."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.mode_monitor import ModeAnswer
from companion.link.mode_commands import FIRST_ROUND_TRIP, HOLD_UNANSWERED, LIFETIME, LONGEST_UNANSWERED
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import MODE_REQUEST_COMMAND, Policy, State, read_heartbeat_mode

AUTO, HOLD = 10, 4
SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
ACCEPTED, CHANGED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4


def sent(stage: LoopbackLink, command: int) -> list[Any]:
    """The commands of one number that left so far."""
    return [message for message in stage.sent("COMMAND_LONG") if message.command == command]


def requests(stage: LoopbackLink) -> list[Any]:
    """The requests for a mode that left so far, without the questions whether the script is there."""
    return [message for message in sent(stage, MODE_REQUEST_COMMAND) if message.param1]


def answer(stage: LoopbackLink, command: int, result: int, serial: int = 0) -> None:
    """The autopilot, or its script, answers."""
    stage.send(mavlink.MAVLink_command_ack_message(command, result, 0, serial, 1, 191), (1, 1))
    stage.run(0.02)


def started(result: int | None = ACCEPTED) -> LoopbackLink:
    """A link whose question for the script was answered with `result`, None: not at all."""
    stage = LoopbackLink()
    stage.run(0.2)
    if result is not None:
        answer(stage, MODE_REQUEST_COMMAND, result, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    return stage


def test_a_question_whether_the_script_is_there_changes_no_mode() -> None:
    stage = started()
    (question,) = sent(stage, MODE_REQUEST_COMMAND)
    assert (question.target_system, question.target_component, question.param1) == (1, 1, 0)
    assert stage.link.modes.compares


def test_it_is_asked_again_until_it_is_answered_and_later_now_and_then() -> None:
    stage = started(None)
    stage.run(3.0)
    assert len(sent(stage, MODE_REQUEST_COMMAND)) >= 3
    stage = started()
    stage.run(10.0)
    assert len(sent(stage, MODE_REQUEST_COMMAND)) == 3


def test_where_the_script_was_heard_modes_are_asked_for_with_what_they_were_decided_on() -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    (request,) = requests(stage)
    assert (request.param1, request.param2, request.param3) == (7, AUTO, HOLD)
    assert not sent(stage, SET_MODE)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(request.param4))
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]
    stage.run(1.0)
    assert not sent(stage, SET_MODE)


@pytest.mark.parametrize("script", [ACCEPTED, UNSUPPORTED])
def test_a_resume_leaves_after_the_heartbeat_that_tells_of_the_end_of_a_fault(script: int) -> None:
    """Else the script on the autopilot, which still believes in the fault, holds again."""
    stage = started(script)
    stage.link.set_state(State.FAULT, 7, Policy.HOLD)
    stage.run(0.1)
    stage.link.set_state(State.HOLDING, 7, Policy.HOLD)
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.1)
    told, resume = (frame.message for frame in stage.frames[-2:])
    assert told.get_type() == "HEARTBEAT"
    assert read_heartbeat_mode(told.custom_mode)[0] is State.HOLDING
    assert resume.command == (MODE_REQUEST_COMMAND if script is ACCEPTED else SET_MODE)


def test_each_request_has_a_serial_number_of_its_own() -> None:
    stage = started()
    for _ in range(5):
        stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
        stage.run(0.1)
    serials = [int(message.param4) for message in sent(stage, MODE_REQUEST_COMMAND)]
    assert len(set(serials)) == len(serials) == 6


def test_a_hold_that_the_script_does_not_answer_goes_past_it() -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(HOLD_UNANSWERED - 0.05)
    assert not sent(stage, SET_MODE)
    stage.run(0.1)
    (command,) = sent(stage, SET_MODE)
    assert (command.param2, command.param7) == (HOLD, 7)


def started_late(seconds: float) -> LoopbackLink:
    """A link over whose wire the script's answers take so long."""
    stage = started(None)
    question = sent(stage, MODE_REQUEST_COMMAND)[-1]
    stage.run(seconds - 0.2)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(question.param4))
    return stage


def test_over_a_slow_wire_it_waits_for_an_answer_that_is_on_its_way() -> None:
    stage = started_late(1.0)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.8)
    (request,) = requests(stage)
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, int(request.param4))
    stage.run(1.0)
    assert not sent(stage, SET_MODE)


def test_but_no_longer_also_where_the_hold_is_requested_again_meanwhile() -> None:
    stage = started_late(1.0)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.75)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.35)
    assert len(requests(stage)) == 2
    assert [message.param2 for message in sent(stage, SET_MODE)] == [HOLD]


def test_an_answer_to_the_first_of_two_requests_counts_for_both() -> None:
    stage = started_late(1.0)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.75)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, int(requests(stage)[0].param4))
    stage.run(1.0)
    assert not sent(stage, SET_MODE)


def test_nor_longer_than_two_seconds_over_the_slowest_wire() -> None:
    stage = started_late(2.5)
    stage.link.modes.command(HOLD, 8.0, expected=AUTO, hold=7)
    stage.link.modes.send_hold_now(8.0)
    for now, past in ((8.0 + LONGEST_UNANSWERED - 0.125, 0), (8.0 + LONGEST_UNANSWERED, 1)):
        stage.link.modes.tick(now)
        stage.collect(now)
        assert len(sent(stage, SET_MODE)) == past


def test_an_answer_to_a_request_of_an_earlier_hold_does_not_count_for_a_later_one() -> None:
    stage = started()
    for hold in (7, 8):
        stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=hold)
        stage.run(0.05)
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, int(requests(stage)[0].param4))
    stage.run(HOLD_UNANSWERED)
    assert [(message.param2, message.param7) for message in sent(stage, SET_MODE)] == [(HOLD, 8)]


@pytest.mark.parametrize("result", [CHANGED, DENIED, FAILED])
def test_one_that_the_script_refuses_does_not(result: int) -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    answer(stage, MODE_REQUEST_COMMAND, result, int(requests(stage)[-1].param4))
    stage.run(1.0)
    assert not sent(stage, SET_MODE)
    by_hand = result in (CHANGED, DENIED)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=False, by_hand=by_hand)]


@pytest.mark.parametrize("result", [CHANGED, DENIED, FAILED])
def test_a_resume_that_finds_another_mode_says_not_whose_that_is(result: int) -> None:
    stage = started()
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    answer(stage, MODE_REQUEST_COMMAND, result, int(requests(stage)[-1].param4))
    assert stage.reported(ModeAnswer) == [ModeAnswer(AUTO, accepted=False, by_hand=result == DENIED)]


def test_a_hold_that_goes_past_the_script_is_not_taken_over_by_itself() -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(HOLD_UNANSWERED + 0.05)
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, int(requests(stage)[-1].param4))
    assert stage.reported(ModeAnswer) == []
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]


def test_a_late_answer_to_the_resume_does_not_keep_its_hold_from_going_past_the_script() -> None:
    stage = started()
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(requests(stage)[0].param4))
    stage.run(HOLD_UNANSWERED)
    assert [message.param2 for message in sent(stage, SET_MODE)] == [HOLD]


def test_an_answer_about_an_earlier_hold_says_nothing_of_this_one() -> None:
    stage = started()
    for number in (7, 8):
        stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=number)
        stage.run(0.05)
    first, second = (int(request.param4) for request in requests(stage))
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, first)
    assert stage.reported(ModeAnswer) == []
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, second)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]


def test_a_resume_that_was_dropped_as_another_component_took_our_ids_is_not_answered() -> None:
    stage = started(UNSUPPORTED)
    stage.near.full = True
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), (1, 191))
    stage.run(0.05)
    stage.near.full = False
    stage.run(0.05)
    assert not sent(stage, SET_MODE)
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == []


def test_a_resume_never_goes_past_a_script_that_was_heard() -> None:
    stage = started()
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(2.0)
    answer(stage, MODE_REQUEST_COMMAND, UNSUPPORTED, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(2.0)
    assert not sent(stage, SET_MODE)


def test_nor_before_it_is_known_whether_there_is_one() -> None:
    stage = started(None)
    assert not stage.link.modes.takes_resume
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(2.0)
    assert not sent(stage, SET_MODE)
    assert not requests(stage)


def test_nor_while_another_component_uses_our_ids_but_a_hold_is() -> None:
    stage = started()
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), (1, 191))
    stage.run(0.02)
    assert not stage.link.modes.takes_resume
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    assert not requests(stage)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    assert [message.param3 for message in requests(stage)] == [HOLD]
    stage.run(11.0)
    assert stage.link.modes.takes_resume


def test_a_hold_does_not_wait_for_that() -> None:
    stage = started(None)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    assert len(sent(stage, SET_MODE)) == 1


def test_without_a_script_a_resume_is_set() -> None:
    stage = started(UNSUPPORTED)
    assert not stage.link.modes.compares
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    assert [message.param2 for message in sent(stage, SET_MODE)] == [AUTO]


def test_after_a_silence_of_the_autopilot_it_is_asked_anew() -> None:
    stage = started()
    vehicle, stage.vehicle = stage.vehicle, None
    stage.run(4.0)
    stage.vehicle = vehicle
    stage.run(1.2)
    assert not stage.link.modes.compares
    answer(stage, MODE_REQUEST_COMMAND, UNSUPPORTED, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    assert len(sent(stage, SET_MODE)) == 1


def test_a_death_holds_without_asking_the_script() -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now)
    stage.run(0.05)
    assert [message.param2 for message in sent(stage, SET_MODE)] == [HOLD]


def test_an_answer_that_may_be_one_of_two_commands_says_nothing() -> None:
    stage = started(UNSUPPORTED)
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.05)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.05)
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == []
    answer(stage, SET_MODE, ACCEPTED)
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]


def test_a_command_that_never_left_is_not_answered() -> None:
    stage = started(UNSUPPORTED)
    stage.far.full = stage.near.full = True
    stage.link.modes.command(AUTO, stage.now, expected=HOLD, hold=7)
    stage.run(0.2)
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.far.full = stage.near.full = False
    stage.run(0.2)
    assert [message.param2 for message in sent(stage, SET_MODE)] == [HOLD]
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]


def test_a_command_that_leaves_at_its_last_moment_is_answered() -> None:
    stage = started(UNSUPPORTED)
    stage.now = 8.0
    stage.link.modes.command(HOLD, stage.now)
    stage.now += LIFETIME
    stage.link.modes.send_hold_now(stage.now)
    stage.link.modes.tick(stage.now)
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == [ModeAnswer(HOLD, accepted=True)]


@pytest.mark.parametrize(("late", "told"), [(0.0, [ModeAnswer(HOLD, accepted=True)]), (0.02, [])])
def test_an_answer_later_than_five_seconds_counts_for_nothing(late: float, told: list[ModeAnswer]) -> None:
    stage = started(UNSUPPORTED)
    stage.now = 8.0
    stage.link.modes.command(HOLD, stage.now)
    stage.link.modes.send_hold_now(stage.now)
    stage.run(4.9)
    stage.now = 13.0 + late
    answer(stage, SET_MODE, ACCEPTED)
    assert stage.reported(ModeAnswer) == told


def test_a_hold_may_leave_at_once_and_a_resume_waits_for_its_turn() -> None:
    stage = started(UNSUPPORTED)
    for mode in (AUTO, HOLD):
        stage.link.modes.command(mode, stage.now)
        assert stage.link.modes.resume_waits == (mode == AUTO)
        stage.link.modes.send_hold_now(stage.now)
    stage.collect(stage.now)
    assert [message.param2 for message in sent(stage, SET_MODE)] == [HOLD]


def test_a_question_for_the_script_that_waits_while_a_command_is_cancelled_is_answered_all_the_same() -> None:
    stage = LoopbackLink()
    stage.near.full = True
    stage.run(0.2)
    stage.link.modes.cancel()
    stage.near.full = False
    stage.run(0.8)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, int(sent(stage, MODE_REQUEST_COMMAND)[-1].param4))
    assert stage.link.modes.compares


def test_a_hold_that_is_shown_is_not_commanded_past_the_script_any_more() -> None:
    stage = started()
    stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
    stage.run(0.1)
    stage.link.modes.cancel()
    stage.run(1.0)
    assert not sent(stage, SET_MODE)


def test_the_round_trip_is_measured_and_falls_slowly() -> None:
    stage = started(None)
    assert stage.link.modes.round_trip == FIRST_ROUND_TRIP
    for wait, low, high in ((0.8, 0.75, 0.9), (0.1, 0.4, 0.55), (0.1, 0.25, 0.35)):
        stage.link.modes.command(HOLD, stage.now)
        stage.run(wait)
        answer(stage, SET_MODE, ACCEPTED)
        assert low <= stage.link.modes.round_trip <= high


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from([176, 31014, 511]), st.integers(0, 9), st.integers(-5, 5)), max_size=20
    )
)
def test_answers_to_nothing_are_survived_and_report_nothing(answers: list[tuple[int, int, int]]) -> None:
    stage = LoopbackLink()
    stage.run(0.05)
    for command, result, serial in answers:
        answer(stage, command, result, serial)
    assert stage.reported(ModeAnswer) == []


def test_an_autopilot_whose_answers_contradict_each_other_is_not_believed() -> None:
    stage = LoopbackLink()
    stage.run(0.2)
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    px4 = mavlink.MAVLink_heartbeat_message(10, mavlink.MAV_AUTOPILOT_PX4, base, 0x04040000, 4, 3)
    stage.send(px4, (1, 1))
    stage.run(0.02)
    stage.link.modes.command(0x03040000, stage.now)
    stage.run(0.02)
    answer(stage, SET_MODE, UNSUPPORTED)
    assert stage.reported(ModeAnswer) == []
