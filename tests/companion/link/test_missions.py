"""What the autopilot reports of its mission: MISSION_CURRENT and MISSION_ITEM_REACHED."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

from companion.link.inbound import VehicleUpdate
from companion.sim.loopback_link import LoopbackLink
from companion.vehicle.state import Mission, MissionState

ACTIVE, COMPLETE = MissionState.ACTIVE, MissionState.COMPLETE
PILOT = (1, 1)
MESSAGE = 42


def current(seq: int, total: int = 0, state: int = 0) -> mavlink.MAVLink_mission_current_message:
    return mavlink.MAVLink_mission_current_message(seq, total, state, 1)


def reached(seq: int) -> mavlink.MAVLink_mission_item_reached_message:
    return mavlink.MAVLink_mission_item_reached_message(seq)


def with_id(seq: int, number: int) -> bytes:
    """MISSION_CURRENT as an autopilot with a newer dialect sends it, with the ids of its plans."""
    payload = bytes([seq, 0, 5, 0, 3, 1]) + number.to_bytes(4, "little") + bytes(7) + b"\1"
    frame = bytes([len(payload), 0, 0, 0, 1, 1, MESSAGE, 0, 0]) + payload
    crc = x25crc(frame + bytes([mavlink.MAVLink_mission_current_message.crc_extra])).crc
    return b"\xfd" + frame + int(crc).to_bytes(2, "little")


@pytest.fixture
def stage() -> LoopbackLink:
    made = LoopbackLink()
    made.run(0.1)
    return made


def mission(stage: LoopbackLink) -> Mission:
    assert stage.link.vehicle is not None
    assert stage.link.vehicle.mission is not None
    return stage.link.vehicle.mission


def heard(stage: LoopbackLink, *messages: mavlink.MAVLink_message) -> Mission:
    """The mission once these have come, one after the other."""
    for message in messages:
        stage.send(message, PILOT)
        stage.run(0.1)
    return mission(stage)


def test_item_total_and_state_are_reported(stage: LoopbackLink) -> None:
    told = heard(stage, current(3, 5, 3))
    assert (told.item, told.total, told.state, told.id, told.fresh) == (3, 5, ACTIVE, 0, True)
    assert stage.reported(VehicleUpdate)[-1].vehicle.mission == told


@pytest.mark.parametrize("mavlink1", [True, False])
def test_what_old_firmware_does_not_report_is_not_known(stage: LoopbackLink, mavlink1: bool) -> None:
    stage.mavlink1 = mavlink1
    told = heard(stage, current(3))
    assert (told.item, told.total, told.state, told.id) == (3, None, MissionState.UNKNOWN, 0)


def test_no_mission_has_no_items_and_a_state_from_the_future_is_not_known(stage: LoopbackLink) -> None:
    assert heard(stage, current(0, 65535, 1)).total is None
    assert heard(stage, current(0, 5, 77)).state is MissionState.UNKNOWN


def test_the_id_of_the_mission_is_read_where_the_autopilot_reports_it(stage: LoopbackLink) -> None:
    stage.far.write(with_id(3, 0xA1B2C3D4))
    stage.run(0.1)
    assert (mission(stage).item, mission(stage).total, mission(stage).id) == (3, 5, 0xA1B2C3D4)


def test_another_vehicles_mission_is_not_ours(stage: LoopbackLink) -> None:
    stage.send(current(3, 5, 5), (2, 1))
    stage.send(current(3, 5, 5), (1, 190))
    stage.run(0.1)
    assert stage.link.vehicle is not None
    assert stage.link.vehicle.mission is None


def test_an_item_that_was_reached_before_the_mission_is_known_says_nothing(stage: LoopbackLink) -> None:
    stage.send(reached(5), PILOT)
    stage.run(0.1)
    assert heard(stage, current(5)).reached is None


def test_the_state_is_not_known_any_more_when_it_was_not_reported_for_5_s(stage: LoopbackLink) -> None:
    heard(stage, current(5, 5, 5))
    stage.run(4.7)
    assert (mission(stage).state, mission(stage).fresh) == (COMPLETE, True)
    stage.run(0.5)
    assert (mission(stage).state, mission(stage).fresh) == (MissionState.UNKNOWN, False)
    assert heard(stage, current(5, 5, 5)).fresh


def test_after_a_change_of_mode_it_counts_once_it_is_reported_again(stage: LoopbackLink) -> None:
    heard(stage, current(5, 5, 5), reached(5))
    stage.mode = 4
    stage.run(1.1)
    assert (mission(stage).fresh, mission(stage).reached) == (False, None)
    assert heard(stage, current(5, 5, 5)).fresh


@pytest.mark.parametrize(
    ("messages", "last"),
    [
        ([current(5, 5), reached(5)], True),
        ([current(5, 5), reached(4)], False),
        ([current(5, 5), reached(4), current(5, 5)], False),
        ([current(6, 5)], True),
        ([current(5), reached(5)], False),
        ([current(5), reached(5), current(5)], True),
        ([current(4), reached(4), current(5)], False),
        ([current(5, 5), reached(5), current(1, 5)], False),
        ([current(5, 5), reached(5), current(1, 5), current(5, 5)], False),
        ([current(5, 5), reached(5), current(5, 4)], True),
        ([current(5, 5), reached(5), current(5, 6)], False),
    ],
)
def test_the_last_item_was_reached(
    stage: LoopbackLink, messages: list[mavlink.MAVLink_message], last: bool
) -> None:
    assert heard(stage, *messages).at_last(1) is last


def test_it_is_asked_for_until_it_comes_and_again_when_it_falls_silent(stage: LoopbackLink) -> None:
    def asked() -> list[tuple[float, float]]:
        sent = [one for one in stage.sent("COMMAND_LONG") if one.command == 511 and one.param1 == MESSAGE]
        return [(one.param1, one.param2) for one in sent]

    stage.run(5.0)
    assert asked() == [(MESSAGE, 1_000_000)]
    for _ in range(20):
        stage.send(current(3, 5, 3), PILOT)
        stage.run(1.0)
    assert len(asked()) == 1
    stage.run(7.0)
    assert len(asked()) == 2
