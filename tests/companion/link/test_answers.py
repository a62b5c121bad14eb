import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, Tap
from companion.config.link_settings import LinkSettings
from companion.link.inbound import PolicyRequest
from companion.sim.loopback_link import LoopbackLink
from companion.wire.answers import Acknowledgement, Answer, Via
from companion.wire.ids import (
    PAGE_SENDER,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_ANSWER,
    TUNNEL_SUMMARY,
    Motion,
    Outcome,
    Policy,
    Reasons,
    Result,
    Stage,
)

ACK = Acknowledgement(
    9, 7, Result.APPLIED, Stage.CLOSED, Outcome.ANSWERED, 0.1, 0.2, Reasons.NONE, 5, "C7 closed: answered"
)
GO = Answer(7, Motion.GO, (SetWord("drum", -1.0),), 9)
GROUND = (255, 190)


def tunnel(
    payload: bytes, *, target: tuple[int, int] = (1, 191), kind: int = TUNNEL_ANSWER, length: int = -1
) -> Any:
    size = len(payload) if length < 0 else length
    return mavlink.MAVLink_tunnel_message(*target, kind, size, payload + bytes(128 - len(payload)))


def command(
    p1: float,
    p2: float,
    p3: float = 0,
    p4: float = 0,
    *,
    number: int = 31010,
    target: tuple[int, int] = (1, 191),
    again: int = 0,
) -> Any:
    return mavlink.MAVLink_command_long_message(*target, number, again, p1, p2, p3, p4, 0, 0, 0)


def acknowledgements(stage: LoopbackLink) -> list[Acknowledgement]:
    return [Acknowledgement.unpack(payload) for payload in stage.tunnels(TUNNEL_ACKNOWLEDGEMENT)]


def results(stage: LoopbackLink) -> list[tuple[int, int]]:
    return [(ack.command, ack.result) for ack in stage.sent("COMMAND_ACK")]


def heard(stage: LoopbackLink, *messages: Any, sender: tuple[int, int] = GROUND) -> list[Answer]:
    """What the link reports when these messages come in."""
    before = len(stage.reported(Answer))
    for message in messages:
        stage.send(message, sender)
    stage.run(0.3)
    return stage.reported(Answer)[before:]


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.run(0.1)
    return stage


def test_an_answer_is_reported_with_its_sender(stage: LoopbackLink) -> None:
    assert heard(stage, tunnel(GO.pack()), sender=(250, 3)) == [
        Answer(7, Motion.GO, (SetWord("drum", -1.0),), transaction=9, sender=(250, 3), via=Via.TUNNEL)
    ]


def test_the_acknowledgement_goes_to_the_asker_and_nobody_else(stage: LoopbackLink) -> None:
    (request,) = heard(stage, tunnel(GO.pack()), sender=(250, 3))
    stage.link.answers.acknowledge(request, ACK, stage.now)
    stage.run(0.1)
    assert acknowledgements(stage) == [ACK]
    reply = next(
        message for message in stage.sent("TUNNEL") if message.payload_type == TUNNEL_ACKNOWLEDGEMENT
    )
    assert (reply.target_system, reply.target_component) == (250, 3)


def test_the_same_transaction_is_reported_once_and_acknowledged_each_time(stage: LoopbackLink) -> None:
    (request,) = heard(stage, tunnel(GO.pack()))
    assert heard(stage, tunnel(GO.pack())) == []
    assert acknowledgements(stage) == []
    stage.link.answers.acknowledge(request, ACK, stage.now)
    stage.run(0.1)
    for _ in range(3):
        assert heard(stage, tunnel(GO.pack())) == []
    assert acknowledgements(stage) == [ACK] * 4


def test_the_same_number_of_another_sender_is_another_transaction(stage: LoopbackLink) -> None:
    assert len(heard(stage, tunnel(GO.pack()))) == 1
    assert len(heard(stage, tunnel(GO.pack()), sender=(254, 1))) == 1


def test_a_busy_answer_may_be_sent_again(stage: LoopbackLink) -> None:
    (request,) = heard(stage, tunnel(GO.pack()))
    stage.link.answers.acknowledge(request, replace(ACK, result=Result.BUSY), stage.now)
    assert len(heard(stage, tunnel(GO.pack()))) == 1
    assert acknowledgements(stage)[0].result == Result.BUSY


def test_many_transactions_are_remembered_but_not_for_ever(stage: LoopbackLink) -> None:
    for number in range(1, 200):
        message = tunnel(Answer(7, Motion.GO, transaction=number).pack())
        stage.send(message, (245, 1))
        stage.run(0.1, step=0.05)
        for request in stage.reported(Answer)[-1:]:
            stage.link.answers.acknowledge(request, replace(ACK, transaction=number), stage.now)
    assert len(stage.reported(Answer)) == 199
    assert len(stage.link.answer_store) <= 64


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (0, 0, 1, 1, 2)])
def test_a_long_answer_comes_in_parts_in_any_order(stage: LoopbackLink, order: tuple[int, ...]) -> None:
    operations: list[Operation] = [
        SetWord("a" * 90, 1.0),
        Tap(3, (0.1, 0.1, 0.2, 0.2), "drum", -1.0),
        NewEpisode(),
    ]
    parts = [Answer(7, Motion.NONE, (op,), 5).pack(part, 3) for part, op in enumerate(operations)]
    (request,) = heard(stage, *(tunnel(parts[number]) for number in order))
    assert request.operations == tuple(operations)
    assert request.transaction == 5


def test_no_flood_of_another_sender_makes_an_answer_count_twice(stage: LoopbackLink) -> None:
    (request,) = heard(stage, tunnel(GO.pack()))
    stage.link.answers.acknowledge(request, ACK, stage.now)
    for number in range(100, 200):
        stage.send(tunnel(Answer(7, Motion.GO, transaction=number).pack()), (254, 1))
        stage.run(0.06, step=0.03)
    assert heard(stage, tunnel(GO.pack())) == []
    assert acknowledgements(stage)[-1] == ACK


@pytest.mark.parametrize("within", [None, 77.0], ids=["as a rule", "a slow perceiver"])
def test_an_answer_that_is_not_decided_yet_is_not_handed_on_again(
    stage: LoopbackLink, within: float | None
) -> None:
    if within is not None:
        stage.link.answer_store.set_undecided_for(within)
    go = Answer(7, Motion.GO, (), 5).pack()
    assert len(heard(stage, tunnel(go))) == 1
    stage.run((within or 30.0) - 1.0, step=0.1)
    assert heard(stage, tunnel(go)) == []
    stage.run(2.0)
    assert len(heard(stage, tunnel(go))) == 1, "nobody decides it any more"


def test_no_flood_of_halves_keeps_an_answer_of_two_parts_out(stage: LoopbackLink) -> None:
    first, second = (Answer(7, Motion.GO, (), 5).pack(part, 2) for part in range(2))
    stage.send(tunnel(first))
    for number in range(100, 120):
        stage.send(tunnel(Answer(7, Motion.NONE, (), number).pack(0, 2)), (254, 1))
    assert len(heard(stage, tunnel(second))) == 1


def test_parts_that_come_too_late_are_not_put_together(stage: LoopbackLink) -> None:
    parts = [Answer(7, Motion.NONE, (NewEpisode(),), 5).pack(part, 2) for part in (0, 1)]
    assert heard(stage, tunnel(parts[0])) == []
    stage.run(31, step=0.1)
    assert heard(stage, tunnel(parts[1])) == []


def test_parts_of_several_rounds_of_a_sender_that_backs_off_are_put_together(stage: LoopbackLink) -> None:
    parts = [Answer(7, Motion.NONE, (NewEpisode(),), 5).pack(part, 3) for part in range(3)]
    assert heard(stage, tunnel(parts[0])) == []
    stage.run(8.0)
    assert heard(stage, tunnel(parts[1])) == []
    stage.run(16.0)
    assert len(heard(stage, tunnel(parts[2]))) == 1


def test_parts_that_contradict_each_other_are_refused_with_the_reason(stage: LoopbackLink) -> None:
    assert (
        heard(
            stage,
            tunnel(Answer(7, Motion.NONE, (), 5).pack(0, 2)),
            tunnel(Answer(8, Motion.NONE, (), 5).pack(1, 2)),
        )
        == []
    )
    assert [(ack.result, ack.text) for ack in acknowledgements(stage)] == [
        (Result.REFUSED, "the parts do not belong together")
    ]


def test_more_than_four_parts_are_refused(stage: LoopbackLink) -> None:
    assert heard(stage, tunnel(Answer(7, Motion.NONE, (), 5).pack(0, 5))) == []
    assert acknowledgements(stage)[0].result == Result.REFUSED


def test_halves_of_many_answers_take_bounded_memory(stage: LoopbackLink) -> None:
    for number in range(1, 50):
        heard(stage, tunnel(Answer(7, Motion.NONE, (), number).pack(0, 2)))
    assert len(stage.link.answers._reassembly._open) <= 8


@pytest.mark.parametrize(("system", "may"), [(239, False), (240, True), (250, True), (251, False)])
def test_both_bounds_of_allowed_senders_may_answer_and_nobody_beyond(system: int, may: bool) -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", allowed_senders=(240, 250)))
    stage.run(0.1)
    assert bool(heard(stage, tunnel(GO.pack()), sender=(system, 190))) is may


def test_while_another_component_uses_our_ids_no_answer_counts_on_that_connection(
    stage: LoopbackLink,
) -> None:
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), (1, 191))
    assert heard(stage, tunnel(GO.pack()), command(7, 1)) == []
    stage.run(11.0)
    assert heard(stage, tunnel(GO.pack())) != []


def test_a_sender_that_may_not_is_denied_counted_and_told(stage: LoopbackLink) -> None:
    assert heard(stage, tunnel(GO.pack()), command(7, 1), sender=(42, 1)) == []
    assert [ack.result for ack in acknowledgements(stage)] == [Result.DENIED]
    assert results(stage) == [(31010, 2)]
    assert stage.link.counters.rejected["sender"] == 2
    assert stage.sent("STATUSTEXT")[0].text == "Sender 42 refused: not in allowed_senders"


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (tunnel(b"\x02" + GO.pack()[1:]), "version"),
        (tunnel(GO.pack()[:-3]), "payload"),
        (tunnel(GO.pack() + b"x"), "payload"),
        (tunnel(GO.pack(), length=200), "payload"),
        (tunnel(b""), "payload"),
        (
            tunnel(Answer(1, Motion.NONE, (SetWord("xx", 1.0),), 1).pack().replace(b"xx", b"\xff\xfe")),
            "payload",
        ),
        (tunnel(GO.pack(), target=(1, 0)), "target"),
        (tunnel(GO.pack(), target=(0, 0)), "target"),
    ],
)
def test_payloads_that_are_no_answer_are_counted(stage: LoopbackLink, message: Any, reason: str) -> None:
    assert heard(stage, message) == []
    assert stage.link.counters.rejected == {reason: 1}
    assert acknowledgements(stage) == []


@pytest.mark.parametrize(
    "message",
    [
        tunnel(GO.pack(), target=(2, 191)),
        tunnel(GO.pack(), target=(1, 1)),
        tunnel(GO.pack(), kind=TUNNEL_SUMMARY),
        command(7, 1, target=(2, 191)),
        command(7, 1, target=(1, 1)),
    ],
)
def test_what_is_for_others_passes_by(stage: LoopbackLink, message: Any) -> None:
    assert heard(stage, message) == []
    assert stage.link.counters.rejected == {}
    assert results(stage) == []


@pytest.mark.parametrize(("code", "motion"), [(1, Motion.GO), (2, Motion.STAY), (3, Motion.LOOK_AGAIN)])
def test_a_stock_ground_station_answers_by_command(stage: LoopbackLink, code: int, motion: Motion) -> None:
    assert heard(stage, command(7, code)) == [Answer(7, motion, (), sender=GROUND, via=Via.COMMAND)]


def test_a_stock_ground_station_sets_a_weight_by_command(stage: LoopbackLink) -> None:
    assert heard(stage, command(0, 4, 6, -0.8)) == [
        Answer(0, Motion.NONE, (SetWord("dry bush", -0.8),), sender=GROUND, via=Via.COMMAND)
    ]
    assert heard(stage, command(0, 4, 6, -2)) == [
        Answer(0, Motion.NONE, (ForgetWord("dry bush"),), sender=GROUND, via=Via.COMMAND)
    ]


@pytest.mark.parametrize("call", [0, 12])
def test_a_stock_ground_station_refuses_a_match_by_command(stage: LoopbackLink, call: int) -> None:
    assert heard(stage, command(call, 6)) == [
        Answer(0, Motion.NONE, (OtherPlace(call),), sender=GROUND, via=Via.COMMAND)
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        (math.nan, 1, 0, 0),
        (7, math.nan, 0, 0),
        (7, 0, 0, 0),
        (7, 5, 5, 0),
        (7, 5, math.nan, 0),
        (7, 7, 0, 0),
        (-1, 6, 0, 0),
        (7, 1.5, 0, 0),
        (-1, 1, 0, 0),
        (70_000, 1, 0, 0),
        (math.inf, 1, 0, 0),
        (0, 4, 99, 0.5),
        (0, 4, 0, 0.5),
        (0, 4, math.nan, 0.5),
        (0, 4, 6, math.nan),
        (0, 4, 6, 1.5),
    ],
)
def test_a_command_that_makes_no_sense_is_denied(
    stage: LoopbackLink, wrong: tuple[float, float, float, float]
) -> None:
    assert heard(stage, command(*wrong)) == []
    assert results(stage) == [(31010, 2)]
    assert stage.link.counters.rejected == {"command": 1}


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (Result.APPLIED, 0),
        (Result.APPLIED_NOT_REMEMBERED, 0),
        (Result.NOT_COVERED, 0),
        (Result.STALE, 2),
        (Result.REFUSED, 4),
        (Result.DENIED, 2),
        (Result.BUSY, 1),
    ],
)
def test_a_command_is_acknowledged_by_its_result_and_a_text(
    stage: LoopbackLink, result: Result, expected: int
) -> None:
    (request,) = heard(stage, command(7, 1), sender=(250, 3))
    stage.link.answers.acknowledge(request, replace(ACK, result=result), stage.now)
    stage.run(0.2)
    (ack,) = stage.sent("COMMAND_ACK")
    assert (ack.command, ack.result) == (31010, expected)
    assert (ack.target_system, ack.target_component) == (250, 3)
    assert stage.sent("STATUSTEXT")[0].text == "C7 closed: answered"


def test_a_repeated_command_is_acknowledged_again_and_applied_once(stage: LoopbackLink) -> None:
    (request,) = heard(stage, command(0, 1))
    assert heard(stage, command(0, 1, again=1)) == []
    stage.link.answers.acknowledge(request, ACK, stage.now)
    assert heard(stage, command(0, 1, again=2)) == []
    assert results(stage) == [(31010, 0), (31010, 0)]


def test_the_same_command_given_once_more_is_a_new_wish(stage: LoopbackLink) -> None:
    (request,) = heard(stage, command(0, 1))
    stage.link.answers.acknowledge(request, ACK, stage.now)
    assert len(heard(stage, command(0, 1))) == 1


def test_unknown_commands_get_an_ack_that_says_so(stage: LoopbackLink) -> None:
    heard(stage, command(0, 0, number=400), command(1, 0, number=245))
    assert results(stage) == [(400, 3), (245, 0)]
    whole = mavlink.MAVLink_command_int_message(1, 191, 0, 31011, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    heard(stage, whole)
    assert results(stage)[-1] == (31011, 3)


def test_a_flood_of_requests_is_dropped_and_counted_but_others_are_heard(stage: LoopbackLink) -> None:
    for number in range(1, 301):
        stage.send(tunnel(Answer(7, Motion.STAY, transaction=number).pack()))
    stage.run(0.2)
    assert 60 <= len(stage.reported(Answer)) < 70
    assert stage.link.counters.rejected["rate"] > 200
    assert len(heard(stage, tunnel(GO.pack()), sender=(254, 1))) == 1


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from([45001, 45002, 45003, 45004, 0]),
    st.binary(max_size=128),
    st.integers(0, 255),
    st.tuples(st.integers(0, 255), st.integers(0, 255)),
)
def test_no_tunnel_ever_raises(kind: int, payload: bytes, length: int, sender: tuple[int, int]) -> None:
    stage = LoopbackLink()
    stage.run(0.02)
    heard(stage, tunnel(payload, kind=kind, length=length), tunnel(b"\x01" + payload[:127]), sender=sender)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(width=32), min_size=4, max_size=4), st.integers(0, 65535), st.integers(0, 255))
def test_every_command_to_us_gets_exactly_one_ack_or_is_reported(
    values: list[float], number: int, again: int
) -> None:
    stage = LoopbackLink()
    stage.run(0.02)
    told = heard(stage, command(*values, number=number, again=again))
    assert len(told) + len(results(stage)) == 1


@pytest.mark.parametrize("policy", list(Policy))
def test_a_policy_asked_for_by_command_is_reported_and_acknowledged(
    stage: LoopbackLink, policy: Policy
) -> None:
    request = PolicyRequest(GROUND, policy)
    stage.send(command(0, 5, float(policy)))
    stage.run(0.3)
    assert stage.reported(PolicyRequest) == [request]
    assert results(stage) == [], "not before it is in force"
    stage.link.commands.acknowledge(request, 4, stage.now)
    stage.run(0.2)
    assert results(stage) == [(31010, 4)]


def test_a_policy_from_a_sender_that_may_not_is_denied(stage: LoopbackLink) -> None:
    stage.send(command(0, 5, 3.0), (77, 190))
    stage.run(0.2)
    assert stage.reported(PolicyRequest) == []
    assert results(stage) == [(31010, 2)]


def from_page(stage: LoopbackLink, *payloads: bytes) -> list[Answer]:
    """What the link reports when the rover's own page hands these payloads over."""
    before = len(stage.reported(Answer))
    for payload in payloads:
        stage.link.answers.receive_from_page(payload, stage.now)
    stage.run(0.3)
    return stage.reported(Answer)[before:]


def test_an_answer_of_the_page_is_reported_once_and_acknowledged_to_the_page_alone(
    stage: LoopbackLink,
) -> None:
    told: list[Acknowledgement] = []
    stage.link.answers.to_page = told.append
    (request,) = from_page(stage, GO.pack(), GO.pack())
    assert request == Answer(
        7, Motion.GO, (SetWord("drum", -1.0),), transaction=9, sender=PAGE_SENDER, via=Via.PAGE
    )
    stage.link.answers.acknowledge(request, ACK, stage.now)
    assert from_page(stage, GO.pack()) == []
    assert told == [ACK, ACK]
    assert acknowledgements(stage) == []
    assert stage.sent("STATUSTEXT") == []


def test_the_page_and_a_ground_station_with_its_ids_are_two_senders(stage: LoopbackLink) -> None:
    told: list[Acknowledgement] = []
    stage.link.answers.to_page = told.append
    assert heard(stage, tunnel(GO.pack()), sender=PAGE_SENDER) == [], "0 is no id that may answer"
    assert len(from_page(stage, GO.pack())) == 1
    assert told == []


def test_a_long_answer_of_the_page_comes_in_parts_that_must_belong_together(stage: LoopbackLink) -> None:
    told: list[Acknowledgement] = []
    stage.link.answers.to_page = told.append
    first, second = (Answer(7, Motion.NONE, (SetWord(word, 1.0),), 5) for word in "ab")
    (whole,) = from_page(stage, first.pack(0, 2), second.pack(1, 2))
    assert whole.operations == (SetWord("a", 1.0), SetWord("b", 1.0))
    other = replace(second, transaction=6, target=8).pack(1, 2)
    assert from_page(stage, replace(first, transaction=6).pack(0, 2), other, b"", b"\xff" * 129) == []
    assert [(ack.result, ack.text) for ack in told] == [(Result.REFUSED, "the parts do not belong together")]


def test_a_flood_from_the_page_is_as_bounded_as_one_of_a_sender(stage: LoopbackLink) -> None:
    taken = 0
    for number in range(1, 1001):
        payload = replace(GO, transaction=number).pack()
        stage.link.answers.receive_from_page(payload, stage.now)
        if number % 50 == 0:
            taken += len(from_page(stage))
    assert 60 <= taken <= 60 + 20 * 0.3 * 21


@pytest.mark.parametrize("waited", [1.1, 300.0, float("nan")])
def test_what_the_page_gave_before_a_stall_is_discarded(stage: LoopbackLink, waited: float) -> None:
    stage.link.answers.receive_from_page(GO.pack(), stage.now - waited)
    assert from_page(stage) == []
    assert len(from_page(stage, GO.pack())) == 1, "it is still meant, so it is given again"


def test_a_bug_that_an_answer_of_the_page_finds_does_not_end_the_companion(stage: LoopbackLink) -> None:
    def fail(_: Acknowledgement) -> None:
        raise RuntimeError("a bug")

    stage.link.answers.to_page = fail
    (request,) = from_page(stage, GO.pack())
    stage.link.answer_store.finish(request, ACK, stage.now)
    assert from_page(stage, GO.pack()) == []
