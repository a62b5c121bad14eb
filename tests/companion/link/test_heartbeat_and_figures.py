from dataclasses import replace
from itertools import pairwise

import pytest

from companion.config.link_settings import LinkSettings
from companion.sim.loopback_link import LoopbackLink
from companion.wire.ids import TUNNEL_SUMMARY, HeartbeatMode, Policy, State, read_heartbeat_mode
from companion.wire.messages import MESSAGES
from companion.wire.payloads import Summary
from tests.companion.link.payloads import SUMMARY

NUMBERS = {"AT_TRAV": 0.5, "AT_UNC": 0.1, "AT_SIM": 0.9, "AT_CALL": 0.0}
QUIET = LinkSettings("udpin:0.0.0.0:14550")


def drive(stage: LoopbackLink, seconds: float) -> None:
    """A daemon that judges ten frames a second."""
    for _ in range(round(seconds * 10)):
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers(NUMBERS, stage.now)
        stage.run(0.1)


def test_a_heartbeat_leaves_every_second_from_the_first_moment() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.run(5.05)
    assert stage.times("HEARTBEAT") == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_heartbeat_flips_no_display_of_arming_or_mode() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    heartbeat = stage.sent("HEARTBEAT")[0]
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (1, 191)
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.base_mode) == (18, 8, 0)


@pytest.mark.parametrize(
    ("state", "status"),
    [
        (State.STARTING, 1),
        (State.OFF, 3),
        (State.OK, 4),
        (State.CALLING, 5),
        (State.HOLDING, 5),
        (State.BLOCKED, 5),
        (State.FAULT, 6),
    ],
)
def test_the_heartbeat_tells_the_state_and_the_open_id(state: State, status: int) -> None:
    stage = LoopbackLink()
    stage.link.set_state(state, 513, Policy.HOLD)
    stage.run(0.3)
    heartbeat = stage.sent("HEARTBEAT")[-1]
    assert heartbeat.system_status == status
    assert read_heartbeat_mode(heartbeat.custom_mode) == HeartbeatMode(state, 513, Policy.HOLD)


def test_a_change_of_state_is_told_at_once_but_flapping_is_not() -> None:
    stage = LoopbackLink()
    stage.run(1.5)
    stage.link.set_state(State.FAULT, 0, Policy.REPORT)
    stage.run(0.02)
    assert stage.sent("HEARTBEAT")[-1].system_status == 6
    before = len(stage.frames)
    for step in range(100):
        stage.link.set_state(State.OK if step % 2 else State.FAULT, 0, Policy.REPORT)
        stage.run(0.01)
    assert len(stage.frames) - before <= 5


@pytest.mark.parametrize("url", ["udpin:0.0.0.0:14550", "serial:/dev/ttyAMA0:57600"])
def test_on_a_link_that_hears_the_autopilot_nothing_is_said_before_it(url: str) -> None:
    stage = LoopbackLink(LinkSettings(url), vehicle=None)
    drive(stage, 3)
    stage.link.texts.send("hello", 6, stage.now)
    stage.run(1)
    assert stage.frames == []
    stage.heartbeat(1)
    stage.run(0.05)
    assert stage.frames[0].message.get_type() == "HEARTBEAT"
    assert stage.frames[0].message.get_srcSystem() == 1


def test_the_newest_summary_leaves_once_a_second() -> None:
    stage = LoopbackLink()
    drive(stage, 10)
    summaries = [Summary.unpack(payload) for payload in stage.tunnels(TUNNEL_SUMMARY)]
    assert len(summaries) == 10
    assert [summary.sequence for summary in summaries] == list(range(10))
    assert summaries[3].roi_traversability == 0.5


def test_no_new_frame_means_no_summary() -> None:
    stage = LoopbackLink()
    stage.link.summary(SUMMARY, stage.now)
    stage.run(5)
    assert len(stage.tunnels(TUNNEL_SUMMARY)) == 1


def test_a_summary_that_waited_tells_its_true_age() -> None:
    stage = LoopbackLink()
    stage.link.summary(SUMMARY, stage.now)
    stage.run(0.5)
    stage.link.summary(SUMMARY, stage.now)
    stage.run(1)
    ages = [Summary.unpack(payload).frame_age_ms for payload in stage.tunnels(TUNNEL_SUMMARY)]
    assert ages[0] == 50
    assert 800 < ages[1] < 900, "a newer one was waited for"


def test_a_due_summary_is_the_one_that_comes_then_not_one_that_waited() -> None:
    stage = LoopbackLink()
    for _ in range(110):
        stage.link.summary(SUMMARY, stage.now)
        stage.run(0.09)
    told = [Summary.unpack(payload) for payload in stage.tunnels(TUNNEL_SUMMARY)]
    assert {summary.frame_age_ms for summary in told} == {50}
    assert len(told) == 10, "and the rate stays: one a second"


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("phase", [0.0, 0.03, 0.07])
@pytest.mark.parametrize("unsteady", [3, 6])
def test_nothing_that_can_wait_leaves_right_before_a_summary(
    rate: float, phase: float, unsteady: int
) -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=0.0), vehicle=None)
    stage.link.set_rate("summary", rate)
    stage.run(phase)
    given = {}
    for number in range(1, 301):
        given[number] = stage.now
        stage.link.summary(replace(SUMMARY, frame_id=number), stage.now)
        stage.link.numbers(NUMBERS, stage.now)
        stage.run(0.08 + number % unsteady * 0.01)
    left = [frame for frame in stage.frames if getattr(frame.message, "payload_type", 0) == TUNNEL_SUMMARY]
    waits = [
        frame.at - given[Summary.unpack(bytes(frame.message.payload[:47])).frame_id] for frame in left[2:]
    ]
    assert len(waits) > 20 * rate
    assert max(waits) < 0.015
    beats = stage.times("HEARTBEAT")[2:]
    assert max(after - before for before, after in pairwise(beats)) < 1.2
    assert len(stage.sent("NAMED_VALUE_FLOAT")) > 50


def test_a_device_that_takes_nothing_is_not_asked_without_a_pause() -> None:
    stage = LoopbackLink()
    stage.run(1)
    stage.near.full = True
    stage.run(1.5)
    stage.link.tick(stage.now)
    assert stage.link.wait(stage.now) > 0.0
    stage.near.full = False
    before = len(stage.frames)
    stage.run(2)
    assert len(stage.frames) > before


def test_each_number_leaves_every_two_seconds_and_they_take_turns() -> None:
    stage = LoopbackLink()
    drive(stage, 20)
    numbers = stage.sent("NAMED_VALUE_FLOAT")
    assert [number.name for number in numbers[:4]] == list(NUMBERS)
    assert len(numbers) == 40
    times = stage.times("NAMED_VALUE_FLOAT")
    assert min(after - before for before, after in pairwise(times)) > 0.4


def test_numbers_that_are_not_finite_or_old_are_left_out() -> None:
    stage = LoopbackLink()
    stage.link.numbers({"AT_TRAV": float("nan"), "AT_UNC": 0.5}, stage.now)
    stage.run(30)
    assert {number.name for number in stage.sent("NAMED_VALUE_FLOAT")} == {"AT_UNC"}
    assert len(stage.sent("NAMED_VALUE_FLOAT")) <= 3


def test_quiet_traffic_is_what_the_table_says() -> None:
    stage = LoopbackLink()
    drive(stage, 60)
    sent = stage.link.counters.sent["unsolicited"]
    assert sent == sum(frame.size for frame in stage.frames if frame.message.get_type() != "COMMAND_LONG")
    assert 120 < sent / 60 < 140


def test_no_frame_is_longer_than_the_table_says() -> None:
    stage = LoopbackLink()
    drive(stage, 10)
    rows = {
        "HEARTBEAT": "heartbeat",
        "TUNNEL": "summary",
        "NAMED_VALUE_FLOAT": "number",
        "COMMAND_LONG": "interval",
    }
    for frame in stage.frames:
        assert frame.size <= MESSAGES[rows[frame.message.get_type()]].bytes


def test_what_the_budget_does_not_carry_is_dropped_and_counted_and_the_heartbeat_goes_on() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=60.0, burst=300.0))
    drive(stage, 60)
    assert stage.link.counters.dropped_summaries > 10
    assert len(stage.sent("HEARTBEAT")) >= 59
    last = Summary.unpack(stage.tunnels(TUNNEL_SUMMARY)[-1])
    assert len(stage.tunnels(TUNNEL_SUMMARY)) > 15
    assert last.dropped >= stage.link.counters.dropped_summaries - 2
    assert last.sequence == len(stage.tunnels(TUNNEL_SUMMARY)) - 1


def test_what_the_daemon_says_of_sequence_and_dropped_is_overwritten() -> None:
    stage = LoopbackLink()
    stage.link.summary(replace(SUMMARY, sequence=99, dropped=99), stage.now)
    stage.run(0.1)
    told = Summary.unpack(stage.tunnels(TUNNEL_SUMMARY)[0])
    assert (told.sequence, told.dropped) == (0, 0)
