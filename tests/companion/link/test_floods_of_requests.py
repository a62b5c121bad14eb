"""Somebody asks and asks, under one name or under many: what the companion says by itself still gets out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.access_control import READERS_AT_ONCE, READERS_PER_SECOND
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import TUNNEL_SUMMARY
from tests.companion.link.payloads import SUMMARY

SECONDS = 6
PER_SECOND = 20
OPERATOR = (255, 190)
UNKNOWN = mavlink.MAVLink_command_long_message(1, 191, 31011, 0, 0, 0, 0, 0, 0, 0, 0)
SET = mavlink.MAVLink_param_set_message(1, 191, b"AT_W_GRASS", 0.5, 9)


def flooded(
    senders: Iterable[tuple[int, int]],
    make: Callable[[int], Any] = lambda _: UNKNOWN,
    pace: float = 0.05,
) -> LoopbackLink:
    """Each sender asks 20 times a second for 6 s, while the companion works."""
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", pace=pace))
    stage.link.request_rc_channels()
    names = list(senders)
    for number in range(SECONDS * PER_SECOND):
        for sender in names:
            stage.send(make(number), sender)
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers({"AT_TRAV": 0.5}, stage.now)
        stage.run(1 / PER_SECOND, step=0.025)
    return stage


def test_who_asks_in_every_slot_does_not_silence_summaries_and_questions_to_the_autopilot() -> None:
    stage = flooded([OPERATOR])
    assert len(stage.tunnels(TUNNEL_SUMMARY)) >= SECONDS - 1
    assert len(stage.sent("NAMED_VALUE_FLOAT")) >= 2
    asked = [message.param1 for message in stage.sent("COMMAND_LONG") if message.command == 511]
    assert asked.count(mavlink.MAVLINK_MSG_ID_RC_CHANNELS) >= 2, "the off switch is looked for"


def test_requests_that_fill_the_queue_push_out_only_each_other() -> None:
    stage = flooded([(255, component) for component in range(10)])
    assert len(stage.tunnels(TUNNEL_SUMMARY)) >= SECONDS - 1
    assert stage.link.counters.lost > 0


def test_a_flood_of_one_operator_takes_no_acknowledgement_from_another() -> None:
    stage, other = LoopbackLink(), (254, 190)
    for number in range(60 + SECONDS * PER_SECOND):
        flood = mavlink.MAVLink_param_ext_set_message(1, 191, b"X%d" % number, b"1", 11)
        stage.send(flood, OPERATOR)
        if number >= 60:
            stage.run(1 / PER_SECOND)
        if number % PER_SECOND == 0:
            stage.send(mavlink.MAVLink_param_ext_set_message(1, 191, b"AT_WORDS", b"none", 11), other)
    acknowledged = [message.param_id for message in stage.sent("PARAM_EXT_ACK")]
    assert acknowledged.count("AT_WORDS") >= SECONDS
    assert len(acknowledged) > 3 * SECONDS
    assert stage.link.counters.lost > 0


def test_one_look_at_a_flood_takes_in_no_more_than_a_part_of_it() -> None:
    stage = LoopbackLink()
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 77, 1))
    for _ in range(100):
        stage.far.write(beat * 300)
    stage.link.poll(0.0)
    left = 0
    while stage.near.read():
        left += 1
    assert left > 50


def test_strangers_under_many_names_get_no_more_than_one_of_them() -> None:
    stage = flooded([(system, 1 + system) for system in range(2, 42)])
    answered = len(stage.sent("COMMAND_ACK"))
    assert answered <= READERS_AT_ONCE + READERS_PER_SECOND * SECONDS + 1
    assert stage.link.counters.rejected["rate"] > 3000
    stage.send(UNKNOWN, OPERATOR)
    stage.run(4)
    acked = [(message.target_system, message.target_component) for message in stage.sent("COMMAND_ACK")]
    assert OPERATOR in acked


@pytest.mark.slow
def test_strangers_who_may_not_change_anything_are_named_one_in_a_while() -> None:
    stage = flooded([(system, 7) for system in range(2, 122)], lambda _: SET)
    told = [text for message in stage.sent("STATUSTEXT") if "refused" in (text := message.text)]
    assert 1 <= len(told) <= 1 + SECONDS / 5
    assert len(stage.tunnels(TUNNEL_SUMMARY)) >= SECONDS - 1


def test_the_texts_of_refused_wishes_leave_room_for_others() -> None:
    def nonsense(number: int) -> Any:
        return mavlink.MAVLink_param_ext_set_message(1, 191, b"AT_WORDS", f"x{number}".encode(), 11)

    stage = flooded([OPERATOR], nonsense, pace=0.03)
    assert len(stage.tunnels(TUNNEL_SUMMARY)) >= SECONDS - 1
    stage.link.texts.send("Companion sees again", 5, stage.now)
    stage.run(1)
    assert stage.link.counters.unsaid > 50
    assert "Companion sees again" in [message.text for message in stage.sent("STATUSTEXT")]


def test_what_other_rovers_tell_everybody_takes_no_share_of_the_requests() -> None:
    stage = LoopbackLink()
    told = mavlink.MAVLink_tunnel_message(0, 0, TUNNEL_SUMMARY, 47, bytes(128))
    for second in range(6):
        for rover in range(2, 20):
            stage.send(told, (rover, 191))
        stage.send(mavlink.MAVLink_param_request_read_message(1, 191, b"", second), (42, 1))
        stage.run(1.0)
    assert [message.param_index for message in stage.sent("PARAM_VALUE")] == list(range(6))
    assert stage.link.counters.rejected == {}
