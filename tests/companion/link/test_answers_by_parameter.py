from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import Motion, Outcome, Reasons, Result, Stage

GROUND = (255, 190)


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.run(0.1)
    return stage


def answer(value: float) -> Any:
    return mavlink.MAVLink_param_set_message(1, 191, b"AT_ANSWER", value, 9)


def heard(stage: LoopbackLink, value: float, sender: tuple[int, int] = GROUND) -> list[Answer]:
    before = len(stage.reported(Answer))
    stage.send(answer(value), sender)
    stage.run(0.2)
    return stage.reported(Answer)[before:]


def echoes(stage: LoopbackLink) -> list[float]:
    return [m.param_value for m in stage.sent("PARAM_VALUE") if m.param_id == "AT_ANSWER"]


def reply(stage: LoopbackLink, request: Answer, target: int, result: Result = Result.APPLIED) -> None:
    ack = Acknowledgement(
        0, target, result, Stage.OPEN, Outcome.NONE, None, None, Reasons.NONE, 0, f"C{target} {result.name}"
    )
    stage.link.answers.acknowledge(request, ack, stage.now)
    stage.run(0.2)


@pytest.mark.parametrize("motion", [Motion.GO, Motion.STAY, Motion.LOOK_AGAIN])
@pytest.mark.parametrize("target", [0, 7, 65535])
def test_id_and_motion_are_one_number_and_the_echo_carries_it(
    stage: LoopbackLink, target: int, motion: Motion
) -> None:
    (request,) = heard(stage, 10 * target + motion)
    assert (request.target, request.motion, request.operations) == (target, motion, ())
    assert echoes(stage) == []
    reply(stage, request, target or 7)
    assert echoes(stage) == [10 * target + motion]
    stage.send(mavlink.MAVLink_param_request_read_message(1, 191, b"AT_ANSWER", -1))
    stage.run(0.2)
    assert echoes(stage)[-1] == 0.0


@pytest.mark.parametrize(
    "value", [10.0, 75.0, 9.0, 71.5, -71.0, 655360.0, 655361.0, float("nan"), float("inf")]
)
def test_what_says_nothing_is_refused_with_a_text_and_echoed_as_nothing(
    stage: LoopbackLink, value: float
) -> None:
    assert heard(stage, value) == []
    assert echoes(stage) == [0.0]
    assert stage.sent("STATUSTEXT")[0].text.startswith("AT_ANSWER")
    assert stage.link.counters.rejected == {"range": 1}


def test_a_file_of_parameters_that_sets_it_to_0_is_taken(stage: LoopbackLink) -> None:
    assert heard(stage, 0.0) == []
    assert echoes(stage) == [0.0]
    assert stage.sent("STATUSTEXT") == []


def test_the_same_again_is_echoed_and_applied_once_whether_or_not_it_names_the_id(
    stage: LoopbackLink,
) -> None:
    (request,) = heard(stage, 1)
    assert heard(stage, 1) == [], "undecided"
    reply(stage, request, 7)
    assert heard(stage, 1) == []
    assert heard(stage, 71) == []
    assert echoes(stage) == [1.0, 1.0, 71.0]


def test_seconds_later_it_is_a_new_wish(stage: LoopbackLink) -> None:
    (request,) = heard(stage, 1)
    reply(stage, request, 7)
    stage.run(6.0)
    assert len(heard(stage, 1)) == 1


def test_stay_is_handed_on_each_time(stage: LoopbackLink) -> None:
    (request,) = heard(stage, 72)
    reply(stage, request, 7)
    (go,) = heard(stage, 71)
    reply(stage, go, 7)
    assert [again.motion for again in heard(stage, 72)] == [Motion.STAY]


def test_what_was_refused_may_be_asked_again_at_once(stage: LoopbackLink) -> None:
    (request,) = heard(stage, 71)
    reply(stage, request, 7, Result.STALE)
    assert echoes(stage) == [0.0]
    assert stage.sent("STATUSTEXT")[-1].text == "C7 STALE"
    assert len(heard(stage, 71)) == 1


def test_an_early_answer_without_an_id_does_not_go_to_the_call_by_being_set_again(
    stage: LoopbackLink,
) -> None:
    (request,) = heard(stage, 1)
    reply(stage, request, 0, Result.STALE)
    for _ in range(3):
        stage.run(1.0)
        assert heard(stage, 1) == []
    assert echoes(stage) == [0.0] * 4
    assert len(heard(stage, 71)) == 1, "who names the call has read it"
    stage.run(3.0)
    assert len(heard(stage, 1)) == 1


def test_a_sender_that_may_not_gets_nothing_and_is_counted(stage: LoopbackLink) -> None:
    assert heard(stage, 71, sender=(42, 1)) == []
    assert echoes(stage) == [0.0]
    assert stage.link.counters.rejected == {"sender": 1}


def test_two_ground_stations_are_told_apart(stage: LoopbackLink) -> None:
    (request,) = heard(stage, 71)
    reply(stage, request, 7)
    assert len(heard(stage, 71, sender=(254, 1))) == 1
