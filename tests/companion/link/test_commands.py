import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.link.inbound import ParameterRequest, ResetRequest
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import TUNNEL_SUMMARY
from companion.wire.payloads import Summary
from tests.companion.link.payloads import SUMMARY

GROUND = (255, 190)
ACCEPTED, LATER, DENIED, UNSUPPORTED = 0, 1, 2, 3
REQUEST, SET_RATE, GET_RATE, CAPABILITIES, STORAGE = 512, 511, 510, 520, 245
HEARTBEAT, SUMMARIES, NUMBERS, VERSION = 0, 385, 251, 148


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.run(0.1)
    return stage


def command(number: int, *values: float, target: tuple[int, int] = (1, 191)) -> Any:
    return mavlink.MAVLink_command_long_message(*target, number, 0, *values, *[0.0] * (7 - len(values)))


def ask(stage: LoopbackLink, number: int, *values: float, sender: tuple[int, int] = GROUND) -> int:
    """The result that was acknowledged."""
    stage.send(command(number, *values), sender)
    stage.run(0.3)
    ack = stage.sent("COMMAND_ACK")[-1]
    assert (ack.command, ack.target_system, ack.target_component) == (number, *sender)
    return int(ack.result)


@pytest.mark.parametrize("asked", [(REQUEST, VERSION), (CAPABILITIES, 1)])
def test_the_version_says_what_we_can_do(stage: LoopbackLink, asked: tuple[int, int]) -> None:
    assert ask(stage, *asked, sender=(42, 1)) == ACCEPTED
    (version,) = stage.sent("AUTOPILOT_VERSION")
    for flag in (mavlink.MAV_PROTOCOL_CAPABILITY_FTP, mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2):
        assert version.capabilities & flag
    assert not version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert version.flight_sw_version > 0
    assert 0 < stage.link.counters.sent["asked"] <= 90 + 22


def test_the_newest_summary_is_told_once_and_counts_as_no_other(stage: LoopbackLink) -> None:
    assert ask(stage, REQUEST, SUMMARIES) == LATER, "there is none yet"
    stage.link.summary(SUMMARY, stage.now)
    stage.run(2.0)
    assert ask(stage, REQUEST, SUMMARIES) == ACCEPTED
    told = [Summary.unpack(payload) for payload in stage.tunnels(TUNNEL_SUMMARY)]
    assert [one.sequence for one in told] == [0, 0]
    assert told[1].frame_age_ms > told[0].frame_age_ms


def test_numbers_and_heartbeat_on_request(stage: LoopbackLink) -> None:
    stage.link.numbers({"AT_TRAV": 0.5, "AT_UNC": 0.25}, stage.now)
    stage.link.set_rate("number", 0.0)
    assert ask(stage, REQUEST, NUMBERS) == ACCEPTED
    assert [(m.name, m.value) for m in stage.sent("NAMED_VALUE_FLOAT")] == [
        ("AT_TRAV", 0.5),
        ("AT_UNC", 0.25),
    ]
    before = len(stage.sent("HEARTBEAT"))
    assert ask(stage, REQUEST, HEARTBEAT) == ACCEPTED
    assert len(stage.sent("HEARTBEAT")) == before + 1


@pytest.mark.parametrize(
    ("message_id", "interval", "expected"),
    [
        (SUMMARIES, 200_000, ("AT_SUM_HZ", 5.0)),
        (SUMMARIES, 4e6, ("AT_SUM_HZ", 0.25)),
        (SUMMARIES, -1, ("AT_SUM_HZ", 0.0)),
        (SUMMARIES, 0, ("AT_SUM_HZ", 1.0)),
        (NUMBERS, 500_000, ("AT_NUM_HZ", 2.0)),
        (NUMBERS, 0, ("AT_NUM_HZ", 0.5)),
    ],
)
def test_an_interval_is_the_rate_parameter(
    stage: LoopbackLink, message_id: int, interval: float, expected: tuple[str, float]
) -> None:
    assert ask(stage, SET_RATE, message_id, interval) == ACCEPTED
    (request,) = stage.reported(ParameterRequest)
    assert (request.name, request.value) == expected


@pytest.mark.parametrize(
    ("message_id", "interval", "result"),
    [
        (HEARTBEAT, 0, ACCEPTED),
        (HEARTBEAT, 1e6, ACCEPTED),
        (HEARTBEAT, 2e6, DENIED),
        (HEARTBEAT, -1, DENIED),
        (SUMMARIES, 100_000, DENIED),
        (SUMMARIES, -2, DENIED),
        (SUMMARIES, math.nan, DENIED),
        (SUMMARIES, math.inf, DENIED),
        (math.nan, 1e6, UNSUPPORTED),
        (33, 1e6, UNSUPPORTED),
    ],
)
def test_other_intervals_change_nothing(
    stage: LoopbackLink, message_id: float, interval: float, result: int
) -> None:
    assert ask(stage, SET_RATE, message_id, interval) == result
    assert stage.reported(ParameterRequest) == []


@pytest.mark.parametrize(
    ("message_id", "interval"),
    [(HEARTBEAT, 1_000_000), (SUMMARIES, 1_000_000), (NUMBERS, 2_000_000), (33, 0)],
)
def test_an_interval_is_told_to_anybody(stage: LoopbackLink, message_id: int, interval: int) -> None:
    assert ask(stage, GET_RATE, message_id, sender=(42, 1)) == ACCEPTED
    (told,) = stage.sent("MESSAGE_INTERVAL")
    assert (told.message_id, told.interval_us) == (message_id, interval)


def test_storage_is_always_saved_and_only_a_reset_goes_further(stage: LoopbackLink) -> None:
    assert [ask(stage, STORAGE, first) for first in (0, 1, 3, math.nan)] == [
        ACCEPTED,
        ACCEPTED,
        DENIED,
        DENIED,
    ]
    stage.send(command(STORAGE, 2))
    stage.run(0.3)
    (request,) = stage.reported(ResetRequest)
    assert len(stage.sent("COMMAND_ACK")) == 4
    stage.link.commands.acknowledge(request, ACCEPTED, stage.now)
    stage.run(0.2)
    assert stage.sent("COMMAND_ACK")[-1].result == ACCEPTED


@pytest.mark.parametrize("asked", [(STORAGE, 2), (SET_RATE, SUMMARIES, -1)])
def test_a_sender_that_may_not_change_anything_is_denied_and_counted(
    stage: LoopbackLink, asked: tuple[int, ...]
) -> None:
    assert ask(stage, *asked, sender=(42, 1)) == DENIED
    assert stage.reported(ResetRequest) == stage.reported(ParameterRequest) == []
    assert stage.link.counters.rejected == {"sender": 1}


def test_rates_are_kept_to_until_they_change() -> None:
    stage = LoopbackLink()
    told = {0.0: 0, 1.0: 10, 5.0: 50}
    for rate, expected in told.items():
        stage.link.set_rate("summary", rate)
        stage.run(1.0)
        before = len(stage.tunnels(TUNNEL_SUMMARY))
        for _ in range(100):
            stage.link.summary(SUMMARY, stage.now)
            stage.run(0.1)
        assert len(stage.tunnels(TUNNEL_SUMMARY)) - before == pytest.approx(expected, abs=2)


def test_another_budget_counts_at_once() -> None:
    stage = LoopbackLink()
    stage.link.set_rate("summary", 5.0)
    stage.link.set_budget(50.0, stage.now)
    stage.run(10.0)
    before = stage.link.counters.sent["unsolicited"]
    for _ in range(200):
        stage.link.summary(SUMMARY, stage.now)
        stage.run(0.1)
    assert stage.link.counters.sent["unsolicited"] - before <= 50 * 20 + 600
    assert stage.link.counters.dropped_summaries > 0


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([REQUEST, SET_RATE, GET_RATE, CAPABILITIES, STORAGE, 519, 400]),
    st.floats(width=32),
    st.floats(width=32),
)
def test_every_command_is_acknowledged_once(number: int, first: float, second: float) -> None:
    stage = LoopbackLink()
    stage.run(0.02)
    stage.send(command(number, first, second))
    stage.run(0.2)
    assert len(stage.sent("COMMAND_ACK")) + len(stage.reported(ResetRequest)) == 1
