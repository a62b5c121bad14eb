"""Devices, autopilots and ground stations that come late, go and come again, on either connection."""

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettings
from companion.sim.loopback_link import LoopbackLink, Wire

BOTH = LinkSettings(
    "udpout:127.0.0.1:14550", more={"wifi": ConnectionSettings("udpout:127.0.0.1:14551", budget=0.0)}
)
WAITING = LinkSettings(
    "serial:/dev/ttyAMA0:57600", more={"wifi": ConnectionSettings("udpin:0.0.0.0:14551", budget=0.0)}
)


def wires(stage: LoopbackLink) -> dict[str, Wire]:
    return {"link": stage, "link wifi": stage.more["wifi"]}


@pytest.mark.parametrize("label", ["link", "link wifi"])
def test_a_connection_absent_at_the_start_is_named_and_the_other_speaks(label: str) -> None:
    stage = LoopbackLink(BOTH)
    absent = wires(stage).pop(label)
    (other,) = (wire for name, wire in wires(stage).items() if name != label)
    absent.near.broken = True
    stage.run(3)
    assert str(stage.link.trouble) == f"{label} lost: unplugged"
    assert len(other.sent("HEARTBEAT")) >= 3
    absent.near.broken = False
    stage.run(14)
    assert stage.link.trouble is None
    assert len(absent.sent("HEARTBEAT")) >= 3


@pytest.mark.parametrize("label", ["link", "link wifi"])
def test_a_connection_unplugged_while_running_says_its_heartbeat_at_once_when_it_is_back(label: str) -> None:
    stage = LoopbackLink(BOTH, vehicle=None)
    stage.run(1.2)
    wire = wires(stage)[label]
    wire.near.broken = True
    stage.run(0.1)
    assert str(stage.link.trouble) == f"{label} lost: unplugged"
    wire.near.broken = False
    before = len(wire.frames)
    stage.run(0.6)
    assert wire.frames[before].message.get_type() == "HEARTBEAT"
    assert wire.frames[before].at == pytest.approx(1.7, abs=0.05)


def test_a_connection_is_tried_for_ever_at_most_8_s_apart() -> None:
    stage = LoopbackLink(BOTH)
    wifi = stage.more["wifi"]
    wifi.near.broken = True
    stage.run(300, step=0.1)
    wifi.near.broken = False
    stage.run(8.2, step=0.1)
    assert wifi.sent("HEARTBEAT") != []
    assert len(stage.sent("HEARTBEAT")) >= 300


def test_while_the_autopilot_is_not_heard_anywhere_connections_that_wait_for_it_are_silent() -> None:
    stage = LoopbackLink(WAITING, vehicle=None)
    wifi = stage.more["wifi"]
    wifi.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    stage.link.texts.send("hello", 6, stage.now)
    stage.run(3)
    assert stage.frames == wifi.frames == []
    assert stage.link.wait(stage.now) > 0.05, "and nobody spins"
    stage.heartbeat(1)
    stage.run(0.1)
    assert [wire.frames[0].message.get_type() for wire in (stage, wifi)] == ["HEARTBEAT"] * 2


def test_after_a_reboot_of_the_autopilot_all_connections_say_their_heartbeat_at_once() -> None:
    stage = LoopbackLink(BOTH)
    stage.run(1.3)
    stage.vehicle = None
    stage.run(5.1)
    stage.heartbeat(1)
    before = {name: len(wire.frames) for name, wire in wires(stage).items()}
    stage.run(0.02)
    for name, wire in wires(stage).items():
        assert [frame.message.get_type() for frame in wire.frames[before[name] :]] == ["HEARTBEAT"]


def test_a_ground_station_that_appears_late_or_twice_gets_its_list() -> None:
    stage = LoopbackLink(WAITING)
    wifi = stage.more["wifi"]
    stage.run(30, step=0.05)
    for sender in ((255, 190), (254, 190), (255, 190)):
        before = len(wifi.sent("PARAM_VALUE"))
        wifi.send(mavlink.MAVLink_param_request_list_message(1, 191), sender)
        stage.run(3)
        told = wifi.sent("PARAM_VALUE")[before:]
        assert [message.param_index for message in told] == list(range(told[0].param_count))
    assert stage.sent("PARAM_VALUE") == []


def test_a_connection_that_takes_nothing_delays_nothing_on_the_other() -> None:
    stage = LoopbackLink(BOTH)
    stage.run(1)
    stage.near.full = True
    wifi = stage.more["wifi"]
    for number in range(20):
        stage.link.texts.send(f"text {number}", 6, stage.now)
        stage.run(0.5)
    assert len(wifi.sent("STATUSTEXT")) == 20
    assert stage.link.wait(stage.now) >= 0.0
    assert stage.link.counters.connections["main"].lost > 0
    assert stage.link.counters.connections["wifi"].lost == 0
