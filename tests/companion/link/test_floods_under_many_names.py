"""Somebody asks under 2,815 names that may all answer: the work is bounded, known operators get through."""

from __future__ import annotations

import time
from itertools import cycle, product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from companion.config.link_settings import MAIN, ConnectionSettings, LinkSettings
from companion.link.access_control import (
    COMMON_SHARES,
    KEPT,
    MAX_SHARES,
    OTHER_OPERATORS,
    READERS,
    REQUESTS_AT_ONCE,
    REQUESTS_PER_SECOND,
    AccessControl,
)
from companion.link.inbound import ParameterRequest
from companion.link.limits import LeaseTable
from companion.link.link import READING_FOR, Link
from companion.sim.loopback_link import FileClient, LoopbackLink, pair
from companion.storage.served_tree import Document, Tree
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import TUNNEL_ANSWER, Motion, Outcome, Reasons, Result, Stage
from companion.wire.parameters import build

OPERATOR = (255, 190)
NAMES = [name for name in product(range(245, 256), range(256)) if name != OPERATOR]
SECONDS = 4
PER_TURN = 40
TURN = 0.02
"""2,000 a second."""
GROUND_HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SET = mavlink.MAVLink_param_set_message(1, 191, b"AT_W_GRASS", 0.5, 9)
BOTH = LinkSettings("udpout:127.0.0.1:14550", more={"wifi": ConnectionSettings("udpout:127.0.0.1:14551")})


def answer(transaction: int, part: int = 0, parts: int = 1) -> Any:
    operations = (SetWord(f"word {part}", 1.0),)
    payload = Answer(7, Motion.GO, operations, transaction).pack(part, parts)
    return mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), payload.ljust(128, b"\0"))


def granted(request: Answer) -> Acknowledgement:
    return Acknowledgement(
        request.transaction,
        request.target,
        Result.APPLIED,
        Stage.CLOSED,
        Outcome.NONE,
        None,
        None,
        Reasons.NONE,
        0,
        "noted",
    )


@pytest.mark.slow
def test_2000_answers_a_second_under_many_names_are_bounded_and_the_operator_gets_through() -> None:
    stage, names = LoopbackLink(), cycle(NAMES)
    stage.send(GROUND_HEARTBEAT, OPERATOR)
    stage.run(0.1)
    asked = 0
    for step in range(round(SECONDS / TURN)):
        for _ in range(PER_TURN):
            stage.send(answer(1 + step), next(names))
        if step % 25 == 0:
            asked += 1
            stage.send(answer(10_000 + asked), OPERATOR)
        known = len(stage.heard)
        stage.run(TURN, step=TURN)
        for event in stage.heard[known:]:
            if isinstance(event, Answer):
                stage.link.answers.acknowledge(event, granted(event), stage.now)
    stage.run(1.0)
    let_through = [request.sender for request in stage.reported(Answer)]
    assert let_through.count(OPERATOR) == asked
    shared = REQUESTS_AT_ONCE + REQUESTS_PER_SECOND * SECONDS
    fixed = (MAX_SHARES - 1) * (1 + SECONDS)
    assert shared / 2 < len(let_through) - asked <= shared + fixed
    told = [message for message in stage.sent("TUNNEL") if message.payload_type == TUNNEL_ANSWER + 1]
    assert sum((one.target_system, one.target_component) == OPERATOR for one in told) == asked
    assert len(stage.sent("HEARTBEAT")) >= SECONDS


def test_a_request_heard_on_two_connections_counts_once_in_any_flood() -> None:
    stage = LoopbackLink(BOTH)
    stage.send(GROUND_HEARTBEAT, OPERATOR)
    stage.run(0.5)
    stage.send(SET, OPERATOR)
    for name in NAMES[:1000]:
        stage.send(SET, name)
    stage.run(0.1)
    stage.more["wifi"].send(SET, OPERATOR)
    stage.run(0.1)
    assert [one.sender for one in stage.reported(ParameterRequest)].count(OPERATOR) == 1


def test_the_parts_of_an_answer_find_each_other_in_any_flood() -> None:
    stage, names = LoopbackLink(), cycle(NAMES)
    stage.send(GROUND_HEARTBEAT, OPERATOR)
    stage.run(0.1)
    stage.send(answer(1, 0, 2), OPERATOR)
    for _ in range(100):
        for _ in range(10):
            stage.send(answer(2, 0, 2), next(names))
        stage.run(0.1, step=0.1)
    stage.send(answer(1, 1, 2), OPERATOR)
    stage.run(0.1)
    (request,) = stage.reported(Answer)
    assert (request.sender, len(request.operations)) == (OPERATOR, 2)


def test_file_sessions_of_many_names_make_room_for_an_operator_who_is_known() -> None:
    stage = LoopbackLink(tree=Tree({"state.json": Document(lambda: b"x" * 400)}))
    for number in range(MAX_SHARES - 1):
        stage.send(GROUND_HEARTBEAT, (254, 1 + number))
    stage.send(GROUND_HEARTBEAT, OPERATOR)
    stage.run(0.1)
    for component in (50, 51):
        for session in (0, 1):
            other = FileClient(stage, (250, component))
            assert other.open("/state.json", session=session).data == (400).to_bytes(4, "little")
    operator = FileClient(stage, OPERATOR)
    assert operator.open("/state.json").data == (400).to_bytes(4, "little")
    assert operator.read().data == b"x" * 80


def test_a_reply_to_somebody_known_waits_for_one_frame_of_a_crowd_at_most() -> None:
    stage = LoopbackLink()
    for number in range(MAX_SHARES):
        stage.send(GROUND_HEARTBEAT, (254, 1 + number))
    stage.run(3.0)
    read = mavlink.MAVLink_param_request_read_message(1, 191, b"", 1)
    for name in NAMES[:100]:
        stage.send(answer(1), (name[0], name[1]))
    stage.run(0.02)
    for event in stage.reported(Answer):
        stage.link.answers.acknowledge(event, granted(event), stage.now)
    stage.send(read, (254, 1))
    before = len(stage.sent("TUNNEL"))
    while not stage.sent("PARAM_VALUE"):
        stage.run(0.01)
        assert stage.now < 10.0, "too late"
    assert len(stage.sent("TUNNEL")) - before <= 2


def test_a_connection_that_is_flooded_keeps_no_other_unheard_and_no_turn_long() -> None:
    clock = [0.0]

    def tick() -> float:
        clock[0] += READING_FOR
        return clock[0]

    near, far = pair()
    other_near, other_far = pair()
    link = Link(
        BOTH,
        build([], {}, {}),
        0.0,
        openers={MAIN: lambda: near, "wifi": lambda: other_near},
        clock=tick,
    )
    for _ in range(300):
        far.write(GROUND_HEARTBEAT.pack(mavlink.MAVLink(None, 250, 1)))
    beat = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)
    other_far.write(beat.pack(mavlink.MAVLink(None, 1, 1)))
    link.poll(0.0)
    assert link.vehicle is not None, "each connection is read once at least"
    left = 0
    while near.read():
        left += 1
    assert left >= 298, "the rest waits in the device's buffer"


def test_one_datagram_of_noise_takes_next_to_no_time() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.run(0.1)
    began = time.process_time()
    for _ in range(20):
        stage.far.write(b"\xfe" * 60_000)
    stage.run(0.01)
    assert time.process_time() - began < 0.5, "each took 0.2 s"
    stage.heartbeat(1)
    stage.run(0.1)
    assert stage.link.vehicle is not None


def test_an_error_while_one_connection_sends_or_reads_stops_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stage = LoopbackLink(BOTH)
    stage.run(0.5)

    def fail(*_: object) -> bool:
        raise RuntimeError("nobody foresaw it")

    monkeypatch.setattr(stage.near, "write", fail)
    stage.run(3.0)
    assert len(stage.more["wifi"].sent("HEARTBEAT")) >= 3
    monkeypatch.setattr(stage.near, "read", fail)
    stage.more["wifi"].send(SET, OPERATOR)
    stage.run(0.1)
    assert [one.sender for one in stage.reported(ParameterRequest)] == [OPERATOR]


names = st.tuples(st.sampled_from([245, 250, 255]), st.integers(0, 3))
said = st.lists(st.tuples(names, st.booleans(), st.floats(0.0, 4.0)), max_size=80)


@given(said)
def test_no_number_of_names_is_admitted_more_than_the_shares_allow(
    heard: list[tuple[tuple[int, int], bool, float]],
) -> None:
    access, now = AccessControl((245, 255)), 0.0
    heard_at: dict[tuple[int, int], float] = {}
    admitted = 0
    for sender, asks, pause in heard:
        now += pause
        kept = [
            one for one in heard_at if one in access._shares and one != sender and now - heard_at[one] <= KEPT
        ]
        access.renew_share(sender, now)
        heard_at[sender] = now
        assert all(access.share(one) == one for one in kept), "nobody who was heard lately loses his share"
        assert len(list(access._shares)) <= MAX_SHARES
        assert access.share(sender) in (sender, OTHER_OPERATORS)
        if asks:
            admitted += sum(access.admits(sender, now) for _ in range(70))
            assert admitted <= (MAX_SHARES + 1) * (REQUESTS_AT_ONCE + REQUESTS_PER_SECOND * now)
    assert access.share((9, 9)) == READERS
    assert {OTHER_OPERATORS, READERS} == COMMON_SHARES


@given(st.lists(st.tuples(st.integers(0, 6), st.floats(0.0, 8.0), st.booleans()), max_size=60))
def test_leases_go_to_newcomers_only_from_whoever_is_silent(steps: list[tuple[int, float, bool]]) -> None:
    leases: LeaseTable[int, int] = LeaseTable(3, 10.0)
    now, renewed = 0.0, dict[int, float]()
    for number, (key, pause, surely) in enumerate(steps):
        now += pause
        before = set(leases)
        took = leases.renew(key, number, now if surely else float("-inf"))
        assert took == (key in leases)
        assert {one for one in before if now - renewed.get(one, -1e9) <= 10.0} <= set(leases)
        assert took or len(before) == 3
        assert len(list(leases)) <= 3
        if took:
            assert leases.get(key) == number
            renewed[key] = max(renewed.get(key, -1e9), now if surely else -1e9)
        for gone in before - set(leases):
            del renewed[gone]
