"""A link to a PX4 rover: its modes, its setpoints, and its mode read sooner than by heartbeat."""

from __future__ import annotations

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import LONGEST_PACE, LinkSettings
from companion.link.inbound import VehicleUpdate
from companion.sim.loopback_link import LoopbackLink
from companion.vehicle import px4
from companion.wire.messages import MESSAGES


def heartbeat(stage: LoopbackLink, mode: int = px4.MISSION) -> None:
    stage.send(mavlink.MAVLink_heartbeat_message(10, 12, 0x81, mode, 4, 3), (1, 1))


@pytest.fixture
def stage() -> LoopbackLink:
    """A PX4 rover in MISSION was heard."""
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", pace=0.05), vehicle=None)
    heartbeat(stage)
    stage.run(0.5)
    return stage


@pytest.mark.parametrize(
    ("mode", "main", "sub"), [(px4.MISSION, 4, 4), (px4.LOITER, 4, 3), (px4.OFFBOARD, 6, 0)]
)
def test_a_mode_is_asked_for_by_main_and_sub_mode(
    stage: LoopbackLink, mode: int, main: int, sub: int
) -> None:
    stage.link.modes.command(mode, stage.now)
    stage.run(0.1)
    command = next(message for message in stage.sent("COMMAND_LONG") if message.command == 176)
    assert (command.param1, command.param2, command.param3) == (1, main, sub)


def test_zero_velocity_goes_out_at_the_rate_and_ends(stage: LoopbackLink) -> None:
    stage.link.setpoints.on = True
    for number in range(100):
        stage.link.texts.send(f"text {number}", 4, stage.now)
        stage.run(0.05)
    times = stage.times("SET_POSITION_TARGET_LOCAL_NED")
    assert 25 <= len(times) <= 26, "five a second"
    assert max(later - earlier for earlier, later in pairwise(times)) < 0.3
    stage.link.setpoints.on = False
    before = len(times)
    stage.run(2.0)
    assert len(stage.times("SET_POSITION_TARGET_LOCAL_NED")) == before


def test_a_setpoint_is_zero_velocity_and_nothing_else_for_the_autopilot_alone(stage: LoopbackLink) -> None:
    stage.link.setpoints.on = True
    stage.run(0.1)
    frame = next(f for f in stage.frames if f.message.get_type() == "SET_POSITION_TARGET_LOCAL_NED")
    told = frame.message
    assert (told.target_system, told.target_component) == (1, 1)
    assert (told.coordinate_frame, told.type_mask) == (1, 0x0DC7)
    assert (told.vx, told.vy, told.vz) == (0.0, 0.0, 0.0)
    assert frame.size == MESSAGES["setpoint"].bytes


def test_setpoints_are_the_autopilots_and_cost_no_budget(stage: LoopbackLink) -> None:
    before = dict(stage.link.counters.sent)
    stage.link.setpoints.on = True
    stage.run(10.0)
    after = stage.link.counters.sent
    asked_for = 12 * MESSAGES["interval"].bytes  # streams that this autopilot does not send
    assert 3000 <= after["autopilot"] - before["autopilot"] <= 3300 + asked_for
    assert after["unsolicited"] - before["unsolicited"] <= 300 * 10 + 600


def test_an_answer_gets_out_beside_them_at_the_slowest_pace() -> None:
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", pace=LONGEST_PACE), vehicle=None)
    heartbeat(stage)
    stage.link.setpoints.on = True
    stage.run(2.0)
    for _ in range(5):
        stage.send(mavlink.MAVLink_command_long_message(1, 191, 512, 0, 148, 0, 0, 0, 0, 0, 0))
        stage.run(1.0)
    assert len(stage.sent("COMMAND_ACK")) == len(stage.sent("AUTOPILOT_VERSION")) == 5
    assert stage.link.counters.lost == 0


def test_they_go_on_while_another_component_talks_under_our_ids(stage: LoopbackLink) -> None:
    stage.link.setpoints.on = True
    stage.run(1.0)
    stage.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 7, 4, 3), (1, 191))
    before = len(stage.frames)
    stage.run(3.0)
    said = {frame.message.get_type() for frame in stage.frames[before:]}
    assert said == {"SET_POSITION_TARGET_LOCAL_NED"}
    assert len(stage.frames) - before >= 14


def test_without_a_vehicle_nothing_is_streamed() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.setpoints.on = True
    stage.run(2.0)
    assert stage.sent("SET_POSITION_TARGET_LOCAL_NED") == []


def test_the_mode_is_asked_for_by_interval_until_it_comes(stage: LoopbackLink) -> None:
    def asked() -> int:
        return sum(m.command == 511 and m.param1 == 436 for m in stage.sent("COMMAND_LONG"))

    assert asked() == 1
    for _ in range(40):
        stage.send(mavlink.MAVLink_current_mode_message(0, px4.MISSION, px4.MISSION), (1, 1))
        stage.run(0.5)
    assert asked() == 1
    stage.run(8.0)
    assert asked() >= 2


def test_an_ardupilot_is_not_asked_for_it() -> None:
    stage = LoopbackLink()
    stage.run(12.0)
    assert not [m for m in stage.sent("COMMAND_LONG") if m.command == 511 and m.param1 == 436]


def test_current_mode_tells_the_mode_but_not_that_it_lives(stage: LoopbackLink) -> None:
    stage.run(0.5)
    stage.send(mavlink.MAVLink_current_mode_message(0, px4.LOITER, px4.LOITER), (1, 1))
    stage.send(mavlink.MAVLink_current_mode_message(0, 7, 7), (2, 1))
    stage.run(0.1)
    vehicle = stage.reported(VehicleUpdate)[-1].vehicle
    assert (vehicle.custom_mode, vehicle.armed) == (px4.LOITER, True)
    assert vehicle.heard_at < 0.1
