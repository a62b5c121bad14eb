"""ONBOARD_COMPUTER_STATUS: what it holds, and when it is sent."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LinkSettings
from companion.link.encode import computer_status
from companion.sim.loopback_link import LoopbackLink
from companion.wire.messages import MESSAGES
from tests.companion.link.payloads import CALL, SUMMARY

FIGURES: dict[str, Any] = {
    "temperature": 81.6,
    "throttled": True,
    "under_voltage": False,
    "cpu": 0.424,
    "memory": 1994,
    "memory_free": 800,
    "disk": 29000,
    "disk_free": 0,
}
PERIOD = MESSAGES["computer"].period or 0.0
NOTHING: dict[str, Any] = dict.fromkeys(FIGURES)


def over_the_air(figures: dict[str, Any], uptime: float = 1.0) -> Any:
    """The message as a ground station reads it, and its size."""
    packed = computer_status(figures, uptime).pack(mavlink.MAVLink(None, 1, 191))
    assert len(packed) <= MESSAGES["computer"].bytes
    (message,) = mavlink.MAVLink(None).parse_buffer(packed)
    return message


def test_the_figures_are_where_the_specification_wants_them() -> None:
    message = over_the_air(FIGURES, 12.5)
    assert (message.time_usec, message.uptime, message.type) == (12_500_000, 12_500, 0)
    assert message.temperature_board == 82
    assert message.cpu_combined == [42] * 10
    assert (message.ram_usage, message.ram_total) == (1194, 1994)
    assert (message.storage_usage[0], message.storage_total[0]) == (29000, 29000)
    assert message.status_flags == (
        mavlink.COMPUTER_STATUS_FLAGS_CPU_THROTTLE | mavlink.COMPUTER_STATUS_FLAGS_DISK_FULL
    )


def test_what_is_not_known_says_so() -> None:
    message = over_the_air(NOTHING)
    assert (message.temperature_board, message.status_flags) == (127, 0)
    assert {*message.cpu_cores, *message.cpu_combined, *message.gpu_cores, *message.gpu_combined} == {0xFF}
    assert {message.ram_usage, message.ram_total, *message.storage_usage, *message.link_rx_max} == {
        0xFFFFFFFF
    }
    assert {*message.fan_speed} == {0x7FFF}
    assert {*message.temperature_core} == {127}


SIZES = st.one_of(st.none(), st.integers(0, 2**31), st.integers(0, 2**64))


@given(
    temperature=st.one_of(st.none(), st.floats(-50.0, 150.0)),
    cpu=st.one_of(st.none(), st.floats(0.0, 1.0)),
    memory=st.tuples(SIZES, SIZES),
    disk=st.tuples(SIZES, SIZES),
    uptime=st.floats(0.0, 1e8),
)
def test_whatever_a_computer_tells_can_be_sent(
    temperature: float | None,
    cpu: float | None,
    memory: tuple[int | None, int | None],
    disk: tuple[int | None, int | None],
    uptime: float,
) -> None:
    sizes = {"memory": memory[0], "memory_free": memory[1], "disk": disk[0], "disk_free": disk[1]}
    message = over_the_air({**NOTHING, **sizes, "temperature": temperature, "cpu": cpu}, uptime)
    if temperature is not None:
        assert message.temperature_board == min(126, round(temperature))
    assert max(message.cpu_combined) <= 100 or cpu is None
    used, total = message.storage_usage[0], message.storage_total[0]
    assert used <= total or used == 0xFFFFFFFF
    assert total in (disk[0], 0xFFFFFFFF)


def drive(stage: LoopbackLink, seconds: float, figures: dict[str, Any] | None = None) -> None:
    """A daemon that judges ten frames a second, and measures its computer every second."""
    for step in range(round(seconds * 10)):
        if step % 10 == 0 and figures is not None:
            figures = dict(figures)
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers({"AT_TRAV": 0.5, "AT_UNC": 0.1, "AT_SIM": 0.9, "AT_CALL": 0.0}, stage.now)
        stage.link.computer(figures or {}, stage.now)
        stage.run(0.1)


@pytest.mark.slow
def test_it_comes_every_half_minute_and_summaries_and_heartbeats_lose_nothing_by_it() -> None:
    stage = LoopbackLink()
    drive(stage, 200.0, FIGURES)
    times = stage.times("ONBOARD_COMPUTER_STATUS")
    assert len(times) == 7
    apart = [later - earlier for earlier, later in pairwise(times)]
    assert PERIOD - 0.1 <= min(apart) <= max(apart) < PERIOD + 0.5, apart
    assert stage.link.counters.dropped_summaries == 0
    assert all(later - earlier < 1.2 for earlier, later in pairwise(stage.times("HEARTBEAT")))


@pytest.mark.slow
def test_before_the_first_figures_and_after_the_last_nothing_is_said() -> None:
    stage = LoopbackLink()
    drive(stage, 40.0)
    assert stage.sent("ONBOARD_COMPUTER_STATUS") == []
    drive(stage, 2.0, FIGURES)
    stage.run(100.0)
    assert len(stage.sent("ONBOARD_COMPUTER_STATUS")) == 1, "nothing measures any more"


def test_while_a_call_is_open_it_stays_off_the_wire() -> None:
    stage = LoopbackLink()
    stage.link.alerts.announce(CALL, "C7 unknown thing ahead", stage.now)
    drive(stage, 70.0, FIGURES)
    assert stage.sent("ONBOARD_COMPUTER_STATUS") == []


@pytest.mark.slow
def test_a_budget_without_room_for_it_carries_everything_else() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", budget=160.0, burst=400.0))
    drive(stage, 100.0, FIGURES)
    assert stage.sent("ONBOARD_COMPUTER_STATUS") == []
    assert stage.link.counters.dropped_summaries == 0
