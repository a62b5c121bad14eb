from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetWord, SetWord
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import Result

GROUND = (255, 190)
ACCEPTED, UNSUPPORTED, FAILED, IN_PROGRESS = 0, 1, 2, 3


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.link.text_parameters.set_words({"grass": 1.0, "old wall": -0.8})
    stage.run(0.1)
    return stage


def setting(name: str, value: bytes, *, target: tuple[int, int] = (1, 191), kind: int = 11) -> Any:
    return mavlink.MAVLink_param_ext_set_message(*target, name.encode(), value, kind)


def heard(stage: LoopbackLink, message: Any, sender: tuple[int, int] = GROUND) -> list[Answer]:
    before = len(stage.reported(Answer))
    stage.send(message, sender)
    stage.run(0.3)
    return stage.reported(Answer)[before:]


def acks(stage: LoopbackLink) -> list[tuple[str, str, int]]:
    return [(m.param_id, m.param_value, m.param_result) for m in stage.sent("PARAM_EXT_ACK")]


def decided(stage: LoopbackLink, answer: Answer, result: Result) -> None:
    stage.link.answers.acknowledge(answer, Acknowledgement.without_figures(0, 0, result, ""), stage.now)


def values(stage: LoopbackLink) -> list[tuple[str, str]]:
    return [(m.param_id, m.param_value) for m in stage.sent("PARAM_EXT_VALUE")]


@pytest.mark.parametrize("target", [(1, 191), (1, 0), (0, 0)])
def test_the_list_holds_the_text_and_every_weight(stage: LoopbackLink, target: tuple[int, int]) -> None:
    stage.send(mavlink.MAVLink_param_ext_request_list_message(*target), (42, 1))
    stage.run(2.0)
    assert values(stage) == [
        ("AT_WORDS", "grass: 1; old wall: -0.8"),
        ("AT_W_GRASS", "1"),
        ("AT_W_DRY_BUSH", "-2"),
    ]
    told = stage.sent("PARAM_EXT_VALUE")
    assert {(m.param_type, m.param_count) for m in told} == {(11, 3)}
    assert [m.param_index for m in told] == [0, 1, 2]


def test_one_is_read_by_name_and_by_index(stage: LoopbackLink) -> None:
    stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 191, b"AT_WORDS", -1))
    stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 0, b"", 1))
    stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 191, b"AT_NONE", -1))
    stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 191, b"", 3))
    stage.run(0.5)
    assert values(stage) == [("AT_WORDS", "grass: 1; old wall: -0.8"), ("AT_W_GRASS", "1")]
    assert stage.link.counters.rejected == {"unknown parameter": 2}


def test_a_text_sets_words_also_new_ones_and_takes_others_out_of_use(stage: LoopbackLink) -> None:
    text = "Grass: 0.5; trockenes Böschungsgras:-1 ;old wall: -2;"
    (request,) = heard(stage, setting("AT_WORDS", text.encode()))
    assert request.operations == (
        SetWord("grass", 0.5),
        SetWord("trockenes böschungsgras", -1.0),
        ForgetWord("old wall"),
    )
    assert acks(stage) == []
    decided(stage, request, Result.APPLIED)
    stage.run(0.2)
    ((name, _, result),) = acks(stage)
    assert (name, result) == ("AT_WORDS", ACCEPTED)
    assert stage.sent("PARAM_EXT_ACK")[0]._param_value_raw.rstrip(b"\0").decode() == text, "as it was set"


def test_one_weight_is_set_as_text(stage: LoopbackLink) -> None:
    (request,) = heard(stage, setting("AT_W_DRY_BUSH", b"-0.5"))
    assert request.operations == (SetWord("dry bush", -0.5),)
    decided(stage, request, Result.REFUSED)
    stage.run(0.2)
    assert acks(stage) == [("AT_W_DRY_BUSH", "-2", FAILED)], "with the value in force"


def test_the_same_again_is_in_progress_until_it_is_decided(stage: LoopbackLink) -> None:
    (request,) = heard(stage, setting("AT_WORDS", b"mud: -1"))
    assert heard(stage, setting("AT_WORDS", b"mud: -1")) == []
    assert [result for _, _, result in acks(stage)] == [IN_PROGRESS]
    decided(stage, request, Result.APPLIED)
    assert len(heard(stage, setting("AT_WORDS", b"mud: -1"))) == 1
    assert [result for _, _, result in acks(stage)] == [IN_PROGRESS, ACCEPTED]


def test_each_of_two_texts_is_acknowledged_with_what_became_of_it(stage: LoopbackLink) -> None:
    (first,) = heard(stage, setting("AT_WORDS", b"mud: 0.5"))
    (second,) = heard(stage, setting("AT_WORDS", b"mud: 0.9"))
    decided(stage, first, Result.APPLIED)
    stage.run(0.2)
    decided(stage, second, Result.REFUSED)
    stage.run(0.2)
    in_force = "grass: 1; old wall: -0.8"
    assert acks(stage) == [("AT_WORDS", "mud: 0.5", ACCEPTED), ("AT_WORDS", in_force, FAILED)]


@pytest.mark.parametrize(
    "value",
    [
        b"",
        b"grass",
        b"grass: 2",
        b"grass: nan",
        b"grass: 1_0",
        b"grass: 1; grass: 0",
        b": 1",
        b"a\0b: 1",
        b"gr\xc3: 1",
        "Böschung: 1".encode()[:3],
        b"; ".join(b"w%d: 1" % n for n in range(17)),
        b"x" * 49 + b": 1",
        b"\xff" * 128,
    ],
)
def test_a_text_that_is_none_is_unsupported_and_answered_with_the_old_one(
    stage: LoopbackLink, value: bytes
) -> None:
    assert heard(stage, setting("AT_WORDS", value)) == []
    assert acks(stage) == [("AT_WORDS", "grass: 1; old wall: -0.8", UNSUPPORTED)]
    assert stage.sent("STATUSTEXT")[-1].text.startswith("Refused: ")


def test_another_type_is_unsupported_and_an_unknown_name_fails(stage: LoopbackLink) -> None:
    assert heard(stage, setting("AT_W_GRASS", b"\0\0\0\x3f", kind=9)) == []
    assert heard(stage, setting("AT_NONE", b"1")) == []
    assert acks(stage) == [("AT_W_GRASS", "1", UNSUPPORTED), ("AT_NONE", "", FAILED)]


def test_a_sender_that_may_not_fails_and_one_for_everybody_is_for_nobody(stage: LoopbackLink) -> None:
    assert heard(stage, setting("AT_WORDS", b"grass: -1"), sender=(42, 1)) == []
    assert [result for _, _, result in acks(stage)] == [FAILED]
    assert heard(stage, setting("AT_WORDS", b"grass: -1", target=(1, 0))) == []
    assert stage.link.counters.rejected == {"sender": 1, "target": 1}


def test_a_text_of_many_words_is_told_as_far_as_it_fits(stage: LoopbackLink) -> None:
    stage.link.text_parameters.set_words({f"a rather long word {number}": -0.25 for number in range(16)})
    stage.send(mavlink.MAVLink_param_ext_request_read_message(1, 191, b"AT_WORDS", -1))
    stage.run(0.3)
    (_, text), *_ = values(stage)
    assert text.endswith(": -0.25")
    assert 100 < len(text.encode()) <= 128


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=128), st.sampled_from([b"AT_WORDS", b"AT_W_GRASS"]), st.integers(0, 255))
def test_whatever_is_set_is_read_whole_or_refused(value: bytes, name: bytes, kind: int) -> None:
    stage = LoopbackLink()
    stage.run(0.02)
    stage.send(mavlink.MAVLink_param_ext_set_message(1, 191, name, value, kind))
    stage.run(0.1)
    requests, refused = stage.reported(Answer), stage.sent("PARAM_EXT_ACK")
    assert len(requests) + len(refused) == 1
    for operation in [one for request in requests for one in request.operations]:
        assert isinstance(operation, ForgetWord) or -1.0 <= operation.weight <= 1.0
