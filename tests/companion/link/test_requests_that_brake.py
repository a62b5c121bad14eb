"""A request to hold tells the script how long it may brake, and waits for two answers then."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.calls.mode_monitor import ModeAnswer
from companion.link.mode_commands import HOLD_UNANSWERED
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import MODE_REQUEST_COMMAND
from tests.companion.link.test_mode_commands import (
    ACCEPTED,
    CHANGED,
    SET_MODE,
    answer,
    requests,
    sent,
    started,
)

AUTO, HOLD, GUIDED, MANUAL = 10, 4, 15, 0
IN_PROGRESS = 5


def braking(expected: int = AUTO, brake: float = 2.0) -> LoopbackLink:
    """A link that has just asked for a hold."""
    stage = started()
    stage.link.modes.brake = brake
    shows(stage, expected)
    stage.link.modes.command(HOLD, stage.now, expected=expected, hold=7)
    stage.run(0.05)
    return stage


def shows(stage: LoopbackLink, mode: int) -> None:
    stage.mode = mode
    stage.heartbeat(1)
    stage.run(0.02)


def serial(stage: LoopbackLink) -> int:
    return int(requests(stage)[-1].param4)


def test_every_request_tells_the_time_to_brake_also_the_question_whether_the_script_is_there() -> None:
    stage = braking()
    stage.run(6.0)
    told = [message.param5 for message in sent(stage, MODE_REQUEST_COMMAND)]
    assert told[0] == 0.0
    assert set(told[1:]) == {2.0}
    assert len(told) > 2


def test_two_answers_are_told_and_no_hold_goes_past_the_script() -> None:
    stage = braking()
    answer(stage, MODE_REQUEST_COMMAND, IN_PROGRESS, serial(stage))
    stage.run(3.0)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, serial(stage))
    told = ModeAnswer(HOLD, accepted=True)
    assert stage.reported(ModeAnswer) == [replace(told, brakes_out_of=AUTO), told]
    assert not sent(stage, SET_MODE)


def test_that_somebody_took_over_is_told_after_the_brake_has_begun() -> None:
    stage = braking()
    answer(stage, MODE_REQUEST_COMMAND, IN_PROGRESS, serial(stage))
    answer(stage, MODE_REQUEST_COMMAND, CHANGED, serial(stage))
    assert stage.reported(ModeAnswer)[-1] == ModeAnswer(HOLD, accepted=False, by_hand=True)


@pytest.mark.parametrize("first_is_lost", [True, False])
def test_the_brake_is_no_round_trip(first_is_lost: bool) -> None:
    stage = braking()
    shows(stage, GUIDED)
    if not first_is_lost:
        answer(stage, MODE_REQUEST_COMMAND, IN_PROGRESS, serial(stage))
    before = stage.link.modes.round_trip
    stage.run(2.0)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, serial(stage))
    assert stage.link.modes.round_trip <= before


def test_a_hold_whose_answer_is_lost_does_not_go_past_the_script_once_guided_shows() -> None:
    stage = braking()
    shows(stage, GUIDED)
    stage.run(HOLD_UNANSWERED + 2.0)
    assert not sent(stage, SET_MODE)


@pytest.mark.parametrize(
    ("expected", "brake", "shown"), [(GUIDED, 2.0, GUIDED), (AUTO, 0.0, GUIDED), (AUTO, 2.0, AUTO)]
)
def test_in_any_other_case_it_does(expected: int, brake: float, shown: int) -> None:
    stage = braking(expected, brake)
    shows(stage, shown)
    stage.run(HOLD_UNANSWERED + 0.1)
    assert sent(stage, SET_MODE)


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(
        st.one_of(
            st.tuples(st.just("answer"), st.sampled_from([ACCEPTED, CHANGED, IN_PROGRESS])),
            st.tuples(st.just("ask"), st.just(0)),
            st.tuples(st.just("time"), st.sampled_from([1, 5, 12])),
        ),
        max_size=10,
    )
)
def test_while_guided_shows_no_mode_is_set_past_the_script(steps: list[tuple[str, int]]) -> None:
    stage = braking()
    shows(stage, GUIDED)
    for kind, value in steps:
        if kind == "answer":
            answer(stage, MODE_REQUEST_COMMAND, value, serial(stage))
        elif kind == "ask":
            stage.link.modes.command(HOLD, stage.now, expected=AUTO, hold=7)
        for _ in range(value if kind == "time" else 1):
            shows(stage, GUIDED)
            stage.run(0.08)
    assert not sent(stage, SET_MODE)


def test_a_brake_that_had_begun_before_the_hold_tells_no_round_trip_either() -> None:
    stage = braking(expected=GUIDED)
    answer(stage, MODE_REQUEST_COMMAND, IN_PROGRESS, serial(stage))
    before = stage.link.modes.round_trip
    stage.run(3.0)
    answer(stage, MODE_REQUEST_COMMAND, ACCEPTED, serial(stage))
    assert stage.link.modes.round_trip == before
