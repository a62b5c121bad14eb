import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.calls.mode_monitor import ModeAnswer
from companion.config.link_settings import LinkSettings
from companion.link.inbound import VehicleUpdate
from companion.sim.loopback_link import LoopbackLink
from companion.vehicle.state import Vehicle


def vehicle(stage: LoopbackLink) -> Vehicle:
    assert stage.link.vehicle is not None
    return stage.link.vehicle


def place(
    lat: int = 473_000_000, lon: int = 85_000_000, hdg: int = 9000
) -> mavlink.MAVLink_global_position_int_message:
    return mavlink.MAVLink_global_position_int_message(0, lat, lon, 0, 0, 300, 400, 0, hdg)


def test_the_vehicle_is_known_from_its_heartbeat() -> None:
    stage = LoopbackLink(vehicle=1)
    stage.run(0.1)
    assert vehicle is not None
    assert (
        vehicle(stage).system_id,
        vehicle(stage).autopilot,
        vehicle(stage).custom_mode,
        vehicle(stage).armed,
    ) == (1, 3, 10, True)
    assert stage.reported(VehicleUpdate)[-1].vehicle == vehicle(stage)


def test_another_id_is_adopted_when_the_configured_one_stays_silent() -> None:
    stage = LoopbackLink(vehicle=7)
    stage.run(2.0)
    assert stage.link.vehicle is None
    stage.run(2.0)
    assert vehicle(stage).system_id == 7
    assert stage.sent("HEARTBEAT")[0].get_srcSystem() == 1
    assert stage.sent("HEARTBEAT")[-1].get_srcSystem() == 7


def test_one_that_passed_by_before_ours_does_not_keep_it_from_being_adopted() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.run(0.1)
    stage.heartbeat(9)
    stage.run(1.0)
    stage.vehicle = 7
    stage.run(7.0)
    assert vehicle(stage).system_id == 7


def test_the_first_heartbeat_under_a_new_id_leaves_at_once() -> None:
    stage = LoopbackLink(vehicle=7)
    stage.run(3.5)
    first = next(f for f in stage.frames if f.message.get_srcSystem() == 7)
    assert first.message.get_type() == "HEARTBEAT"
    assert first.at == pytest.approx(3.0, abs=0.05)


def test_the_configured_vehicle_wins_over_one_that_was_heard_first() -> None:
    stage = LoopbackLink(LinkSettings("udpin:0.0.0.0:14550", system_id=3), vehicle=9)
    stage.run(1.0)
    stage.heartbeat(3)
    stage.run(5.0)
    assert vehicle(stage).system_id == 3


def test_another_vehicle_on_the_wire_changes_nothing() -> None:
    stage = LoopbackLink()
    stage.run(0.5)
    stage.mode = 4
    stage.heartbeat(2)
    stage.mode = 10
    stage.send(place(), (2, 1))
    stage.run(0.5)
    assert (vehicle(stage).system_id, vehicle(stage).custom_mode) == (1, 10)
    assert vehicle(stage).position is None


def test_other_components_and_ground_stations_are_no_vehicle() -> None:
    stage = LoopbackLink(vehicle=None)
    camera = mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)
    stage.send(camera, (1, 100))
    stage.send(camera, (1, 1))
    stage.send(mavlink.MAVLink_heartbeat_message(6, 3, 0, 0, 4, 3), (1, 1))
    stage.run(0.5)
    assert stage.link.vehicle is None


def test_position_heading_and_speed_are_told() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.send(place(), (1, 1))
    stage.run(0.1)
    assert vehicle(stage).position == (47.3, 8.5, 90.0)
    assert vehicle(stage).speed == 5.0
    assert vehicle(stage).course == pytest.approx(53.13, abs=0.01)


@pytest.mark.parametrize(
    ("vx", "vy", "course"), [(100, 0, 0.0), (0, 100, 90.0), (-100, 0, 180.0), (0, -100, 270.0), (0, 0, None)]
)
def test_the_course_is_clockwise_from_north_and_unknown_at_a_standstill(
    vx: int, vy: int, course: float | None
) -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    message = place()
    message.vx, message.vy = vx, vy
    stage.send(message, (1, 1))
    stage.run(0.1)
    assert vehicle(stage).course == course


def test_a_position_without_a_fix_a_heading_or_sense_is_not_believed() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.send(place(0, 0), (1, 1))
    stage.send(place(lat=2_000_000_000), (1, 1))
    stage.run(0.1)
    assert vehicle(stage).position is None
    stage.send(place(hdg=65535), (1, 1))
    stage.run(0.1)
    assert vehicle(stage).position == (47.3, 8.5, None)


def test_an_old_position_is_forgotten() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.send(place(), (1, 1))
    stage.run(4.0)
    assert vehicle(stage).position is not None
    stage.run(2.0)
    assert vehicle(stage).position is None
    assert vehicle(stage).speed is None
    assert vehicle(stage).course is None


def test_the_position_is_asked_for_until_it_comes() -> None:
    stage = LoopbackLink()
    stage.run(25.0)
    asked = [message for message in stage.sent("COMMAND_LONG") if message.param1 == 33]
    assert len(asked) == 3
    assert (asked[0].target_system, asked[0].target_component, asked[0].command) == (1, 1, 511)
    assert (asked[0].param1, asked[0].param2) == (33, 500_000)
    stage.send(place(), (1, 1))
    stage.run(2.0)
    assert len([message for message in stage.sent("COMMAND_LONG") if message.param1 == 33]) == 3


def test_a_mode_command_overtakes_everything_and_its_ack_is_reported() -> None:
    stage = LoopbackLink()
    stage.run(15.2)
    for number in range(8):
        stage.link.texts.send(f"text {number}", 6, stage.now)
    before = len(stage.frames)
    stage.link.modes.command(4, stage.now)
    stage.run(0.05)
    command = stage.frames[before].message
    assert (command.get_type(), command.target_system, command.target_component) == ("COMMAND_LONG", 1, 1)
    assert (command.command, command.param1, command.param2) == (176, 1, 4)
    stage.send(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, 1, 191), (1, 1))
    stage.run(0.05)
    assert stage.reported(ModeAnswer) == [ModeAnswer(4, accepted=True)]


def test_acks_for_others_or_from_others_are_not_ours() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.send(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, 255, 190), (1, 1))
    stage.send(mavlink.MAVLink_command_ack_message(511, 0, 0, 0, 1, 191), (1, 1))
    stage.send(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, 1, 191), (2, 1))
    stage.run(0.1)
    assert stage.reported(ModeAnswer) == []


def test_a_mode_command_that_could_not_be_sent_is_forgotten_not_sent_late() -> None:
    stage = LoopbackLink()
    stage.run(0.5)
    stage.near.full = True
    stage.link.modes.command(10, stage.now)
    stage.run(1.5)
    stage.near.full = False
    stage.run(2.0)
    assert [m for m in stage.sent("COMMAND_LONG") if m.command == 176] == []
    assert stage.link.counters.lost >= 1


def test_a_mode_command_without_a_vehicle_goes_nowhere() -> None:
    stage = LoopbackLink(vehicle=None)
    stage.link.modes.command(4, stage.now)
    stage.run(1.0)
    assert stage.sent("COMMAND_LONG") == []


@pytest.mark.parametrize(("kind", "autopilot"), [(10, 4), (2, 3), (2, 12)])
def test_another_kind_of_autopilot_or_vehicle_gets_no_mode_command(kind: int, autopilot: int) -> None:
    stage = LoopbackLink(vehicle=None)
    stage.send(mavlink.MAVLink_heartbeat_message(kind, autopilot, 129, 0x04040000, 4, 3), (1, 1))
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.run(0.1)
    assert [m for m in stage.sent("COMMAND_LONG") if m.command == 176] == []
    assert stage.link.counters.rejected == {"no autopilot for modes": 1}


def test_after_the_autopilot_was_away_a_heartbeat_leaves_at_once() -> None:
    stage = LoopbackLink()
    stage.run(1.3)
    stage.vehicle = None
    stage.run(5.1)
    stage.heartbeat(1)
    before = len(stage.frames)
    stage.run(0.02)
    assert [frame.message.get_type() for frame in stage.frames[before:]] == ["HEARTBEAT"]
