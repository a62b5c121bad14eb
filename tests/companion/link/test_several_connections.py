"""The autopilot on one connection, the ground on another; each has its own budget, numbers and troubles."""

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettingError, LinkSettings
from companion.link.inbound import ParameterRequest, PolicyRequest, RcChannels, VehicleUpdate
from companion.link.outbox import MAX_ROUTES
from companion.sim.loopback_link import LoopbackLink, Wire
from companion.wire.answers import Answer
from companion.wire.ids import TUNNEL_SUMMARY, Policy
from companion.wire.parameters import build
from companion.wire.payloads import Summary
from tests.companion.link.payloads import SUMMARY

GO = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 7, 1, 0, 0, 0, 0, 0)
LIST = mavlink.MAVLink_param_request_list_message(1, 191)
SET = mavlink.MAVLink_param_set_message(1, 191, b"AT_W_GRASS", 0.5, 9)
WIFI = ConnectionSettings("udpout:127.0.0.1:14551")
BOTH = LinkSettings("udpout:127.0.0.1:14550", more={"wifi": WIFI})
OURS = (1, 191)


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink(BOTH)
    stage.run(0.5)
    return stage


@pytest.fixture
def wifi(stage: LoopbackLink) -> Wire:
    return stage.more["wifi"]


def commands(wire: Wire, number: int) -> int:
    return sum(message.command == number for message in wire.sent("COMMAND_LONG"))


def test_everybody_is_told_by_all_connections(stage: LoopbackLink, wifi: Wire) -> None:
    stage.link.texts.send("hello", 6, stage.now)
    stage.run(2)
    for wire in (stage, wifi):
        assert [message.text for message in wire.sent("STATUSTEXT")] == ["hello"]
        assert len(wire.sent("HEARTBEAT")) >= 2


def test_an_answer_leaves_by_the_connection_where_the_asker_was_heard_last(
    stage: LoopbackLink, wifi: Wire
) -> None:
    unknown = mavlink.MAVLink_command_long_message(1, 191, 31011, 0, 0, 0, 0, 0, 0, 0, 0)
    wifi.send(unknown)
    stage.run(0.2)
    assert (commands_acked(wifi), commands_acked(stage)) == (1, 0)
    stage.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    stage.run(1.2)
    stage.send(unknown)
    stage.run(0.2)
    assert (commands_acked(wifi), commands_acked(stage)) == (1, 1)


def commands_acked(wire: Wire) -> int:
    return len(wire.sent("COMMAND_ACK"))


def test_a_list_is_told_only_where_it_was_asked_for(stage: LoopbackLink, wifi: Wire) -> None:
    wifi.send(LIST)
    stage.run(4)
    told = [message.param_index for message in wifi.sent("PARAM_VALUE")]
    assert told == list(range(len(told)))
    assert len(told) > 5
    assert stage.sent("PARAM_VALUE") == []


def test_lists_asked_for_on_two_connections_do_not_disturb_each_other(
    stage: LoopbackLink, wifi: Wire
) -> None:
    wifi.send(LIST, (255, 190))
    stage.run(0.1)
    stage.send(LIST, (254, 190))
    stage.run(4)
    lists = [[message.param_index for message in wire.sent("PARAM_VALUE")] for wire in (stage, wifi)]
    assert lists[0] == lists[1] == list(range(len(lists[0])))


def test_lists_of_texts_asked_for_on_two_connections_are_whole_on_both() -> None:
    stage = LoopbackLink(BOTH, build([f"word {number}" for number in range(12)], {}, {}))
    stage.run(0.5)
    request = mavlink.MAVLink_param_ext_request_list_message(1, 191)
    stage.send(request, (254, 190))
    stage.run(0.1)
    stage.more["wifi"].send(request, (255, 190))
    stage.run(4)
    for wire in (stage, stage.more["wifi"]):
        assert [message.param_index for message in wire.sent("PARAM_EXT_VALUE")] == list(range(13))


def test_a_value_that_somebody_changed_is_told_to_the_others_too(stage: LoopbackLink, wifi: Wire) -> None:
    wifi.send(SET)
    stage.run(0.1)
    stage.link.parameters.set_value("AT_W_GRASS", 0.5, stage.now)
    stage.run(0.2)
    assert [message.param_value for message in wifi.sent("PARAM_VALUE")] == [0.5]
    assert [message.param_value for message in stage.sent("PARAM_VALUE")] == [0.5]


@pytest.mark.parametrize(("message", "kind"), [(GO, Answer), (SET, ParameterRequest)])
def test_a_request_heard_on_two_connections_counts_once(
    stage: LoopbackLink, wifi: Wire, message: object, kind: type
) -> None:
    wifi.send(message)
    stage.send(message)
    stage.run(0.3)
    wifi.mavlink1 = True
    wifi.send(message)
    stage.run(0.2)
    assert len(stage.reported(kind)) == 1
    assert stage.link.counters.rejected["repeated"] == 2


def test_the_same_command_again_later_or_on_the_same_connection_is_a_new_wish(
    stage: LoopbackLink, wifi: Wire
) -> None:
    wifi.send(SET)
    stage.run(0.3)
    wifi.send(SET)
    stage.run(1.5)
    stage.send(SET)
    stage.run(0.2)
    assert len(stage.reported(ParameterRequest)) == 3


def test_the_autopilot_is_commanded_only_where_it_is_heard(stage: LoopbackLink, wifi: Wire) -> None:
    stage.link.modes.command(4, stage.now)
    stage.link.setpoints.on = True
    stage.run(0.5)
    assert commands(stage, 176) == 1
    assert stage.sent("SET_POSITION_TARGET_LOCAL_NED") != []
    assert wifi.sent("COMMAND_LONG") == []
    assert wifi.sent("SET_POSITION_TARGET_LOCAL_NED") == []


def test_an_autopilot_heard_on_two_connections_is_listened_to_on_the_first(
    stage: LoopbackLink, wifi: Wire
) -> None:
    pulses = mavlink.MAVLink_rc_channels_message(0, 16, *[1500] * 18, 255)
    before = len(stage.reported(VehicleUpdate))
    wifi.mode = 4
    wifi.heartbeat(1)
    wifi.send(pulses, (1, 1))
    stage.run(0.1)
    assert len(stage.reported(VehicleUpdate)) == before
    assert stage.reported(RcChannels) == []
    stage.send(pulses, (1, 1))
    stage.run(0.1)
    assert len(stage.reported(RcChannels)) == 1


def test_an_autopilot_that_falls_silent_on_one_connection_is_reached_by_the_other_and_back(
    stage: LoopbackLink, wifi: Wire
) -> None:
    stage.vehicle = None
    for _ in range(5):
        wifi.heartbeat(1)
        stage.run(1)
    assert stage.link.counters.autopilot == "wifi"
    stage.link.modes.command(4, stage.now)
    stage.run(0.2)
    assert (commands(stage, 176), commands(wifi, 176)) == (0, 1)
    assert commands(wifi, 511) >= 1, "streams are asked for anew"
    stage.heartbeat(1)
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.run(0.2)
    assert (commands(stage, 176), commands(wifi, 176)) == (1, 1)


def test_an_autopilot_that_is_heard_seconds_late_on_the_other_connection_has_not_rebooted(
    stage: LoopbackLink, wifi: Wire
) -> None:
    def uptime(wire: Wire, milliseconds: int) -> int:
        wire.send(mavlink.MAVLink_attitude_message(milliseconds, 0, 0, 0, 0, 0, 0), (1, 1))
        stage.run(0.1)
        assert stage.link.vehicle is not None
        return stage.link.vehicle.reboots

    assert uptime(stage, 60_000) == 0
    stage.vehicle = None
    for _ in range(5):
        wifi.heartbeat(1)
        stage.run(1)
    assert uptime(wifi, 55_000) == 0
    stage.heartbeat(1)
    stage.run(0.1)
    assert uptime(stage, 66_000) == 0
    assert uptime(stage, 900) == 1


def test_an_autopilot_adopted_late_on_the_second_connection_is_reached_there() -> None:
    stage = LoopbackLink(BOTH, vehicle=None)
    stage.run(2)
    stage.more["wifi"].heartbeat(1)
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.run(0.2)
    assert (commands(stage, 176), commands(stage.more["wifi"], 176)) == (0, 1)


def test_a_second_vehicle_on_another_connection_is_ignored(stage: LoopbackLink, wifi: Wire) -> None:
    for _ in range(5):
        wifi.heartbeat(2)
        stage.run(1)
    stage.link.modes.command(4, stage.now)
    stage.run(0.2)
    assert stage.link.vehicle is not None
    assert stage.link.vehicle.system_id == 1
    assert (commands(stage, 176), commands(wifi, 176)) == (1, 0)


def test_nothing_is_passed_on_from_one_connection_to_another(stage: LoopbackLink, wifi: Wire) -> None:
    wifi.send(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    stage.send(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0), (1, 1))
    stage.run(1)
    for wire in (stage, wifi):
        assert {(f.message.get_srcSystem(), f.message.get_srcComponent()) for f in wire.frames} == {OURS}
        assert commands(wire, 400) == 0


def test_our_ids_on_one_connection_silence_that_one_and_are_named_on_the_other(
    stage: LoopbackLink, wifi: Wire
) -> None:
    wifi.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 77, 4, 3), OURS)
    stage.run(0.1)
    said, on_main = len(wifi.frames), len(stage.frames)
    stage.run(5)
    assert len(wifi.frames) == said
    assert len(stage.frames) > on_main
    assert [m.text for m in stage.sent("STATUSTEXT")] == ["Another 1/191 on link wifi: silent there"]
    named = "another component 1/191 talks on link wifi: stop it, or this one stays silent"
    assert str(stage.link.trouble) == named
    assert stage.link.counters.connections["wifi"].trouble == named
    assert stage.link.counters.connections["main"].trouble is None
    stage.run(6)
    assert stage.link.trouble is None
    assert len(wifi.frames) > said


def test_our_own_frames_that_come_back_by_another_connection_are_no_clash(
    stage: LoopbackLink, wifi: Wire
) -> None:
    for frame in list(stage.frames):
        wifi.far.write(bytes(frame.message.get_msgbuf()))
    stage.run(1)
    assert stage.link.trouble is None
    assert stage.link.counters.rejected["echo"] >= 1


def test_each_connection_counts_its_own_bytes_summaries_and_drops() -> None:
    slow = ConnectionSettings("udpout:127.0.0.1:14551", budget=60.0, burst=300.0)
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", more={"slow": slow}))
    for _ in range(300):
        stage.link.summary(SUMMARY, stage.now)
        stage.run(0.1, step=0.05)
    wires = {"main": stage, "slow": stage.more["slow"]}
    counters = stage.link.counters
    for name, wire in wires.items():
        told = [Summary.unpack(payload) for payload in wire.tunnels(TUNNEL_SUMMARY)]
        assert [summary.sequence for summary in told] == list(range(len(told)))
        numbers = [frame.message.get_seq() for frame in wire.frames]
        assert numbers == [number % 256 for number in range(len(numbers))]
        own = counters.connections[name]
        assert sum(own.sent.values()) == sum(frame.size for frame in wire.frames)
    assert counters.connections["main"].dropped_summaries == 0
    assert counters.connections["slow"].dropped_summaries > 5
    assert counters.dropped_summaries == counters.connections["slow"].dropped_summaries
    assert counters.sent["unsolicited"] == sum(
        one.sent["unsolicited"] for one in counters.connections.values()
    )


def test_a_sender_for_whom_no_route_is_left_is_answered_everywhere_and_others_keep_theirs(
    stage: LoopbackLink, wifi: Wire
) -> None:
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for number in range(2 * MAX_ROUTES):
        wifi.send(heartbeat, (100 + number, 190))
    stage.run(0.1)
    for sender, everywhere in (((100, 190), 0), ((99 + 2 * MAX_ROUTES, 190), 1)):
        before, on_wifi = commands_acked(stage), commands_acked(wifi)
        stage.link.commands.acknowledge(PolicyRequest(sender, Policy.OFF), 0, stage.now)
        stage.run(0.2)
        assert (commands_acked(stage) - before, commands_acked(wifi) - on_wifi) == (everywhere, 1)


def test_a_flood_of_strangers_does_not_hide_the_autopilot(stage: LoopbackLink, wifi: Wire) -> None:
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for number in range(2 * MAX_ROUTES):
        wifi.send(heartbeat, (10 + number, 190))
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.run(0.1)
    assert (commands(stage, 176), commands(wifi, 176)) == (1, 0)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"wifi": ConnectionSettings("udpout:127.0.0.1:14550")}, r"that of \[link\] too"),
        (
            {f"w{number}": ConnectionSettings(f"udpin:0.0.0.0:{number}") for number in (1, 2, 3, 4)},
            "3 at most",
        ),
        ({"main": WIFI}, "choose a name"),
        ({"Wi Fi": WIFI}, "choose a name"),
        (
            {"a": ConnectionSettings("serial:/dev/x:115200"), "b": ConnectionSettings("serial:/dev/x:57600")},
            r"that of \[link.more.a\] too",
        ),
    ],
)
def test_connections_that_cannot_be_are_refused(more: dict[str, ConnectionSettings], reason: str) -> None:
    with pytest.raises(LinkSettingError, match=reason):
        LinkSettings("udpout:127.0.0.1:14550", more=more)
