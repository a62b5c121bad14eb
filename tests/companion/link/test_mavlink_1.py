"""A connection on which only MAVLink 1 is heard is spoken to in it, and stays useful."""

import struct
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import ConnectionSettings, LinkSettings
from companion.link.encode import MavlinkVersion
from companion.sim.loopback_link import LoopbackLink, SentFrame, Wire
from companion.wire.answers import Answer
from tests.companion.link.payloads import LONG_CALL, SUMMARY

GO = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 1, 1, 0, 0, 0, 0, 0)


def versions(frames: list[SentFrame]) -> list[int]:
    return [1 if frame.message.get_msgbuf()[0] == 254 else 2 for frame in frames]


@pytest.fixture
def stage() -> LoopbackLink:
    stage = LoopbackLink()
    stage.mavlink1 = True
    stage.run(11.5)
    stage.frames.clear()
    return stage


def drive(stage: LoopbackLink, seconds: float) -> None:
    for _ in range(round(seconds * 2)):
        stage.link.summary(SUMMARY, stage.now)
        stage.link.numbers({"AT_TRAV": 0.5}, stage.now)
        stage.run(0.5)


def test_it_is_spoken_after_10_s_in_which_nothing_else_was_heard() -> None:
    stage = LoopbackLink()
    stage.mavlink1 = True
    stage.run(9.9)
    assert set(versions(stage.frames)) == {2}
    assert stage.link.counters.connections["main"].mavlink == 2
    stage.run(2)
    assert versions(stage.frames)[-1] == 1
    assert stage.link.counters.connections["main"].mavlink == 1


def test_one_frame_of_2_is_enough_to_change_back(stage: LoopbackLink) -> None:
    stage.mavlink1 = False
    stage.run(1.5)
    stage.frames.clear()
    stage.mavlink1 = True
    stage.run(5)
    assert set(versions(stage.frames)) == {2}


def test_a_heartbeat_of_2_in_10_s_lets_an_autopilot_change_over(stage: LoopbackLink) -> None:
    stage.run(40)
    beats = [frame for frame in stage.frames if frame.message.get_type() == "HEARTBEAT"]
    assert versions(beats).count(2) == 3
    assert len(beats) == 40


def test_our_own_frames_that_come_back_change_nothing(stage: LoopbackLink) -> None:
    stage.run(12)
    assert 2 in versions(stage.frames)
    for frame in stage.frames[-20:]:
        stage.far.write(bytes(frame.message.get_msgbuf()))
    stage.run(0.1)
    assert stage.link.trouble is None
    assert stage.link.counters.rejected["echo"] >= 10
    assert stage.link.counters.connections["main"].mavlink == 1


def test_numbers_texts_values_and_acks_go_on_and_payloads_are_left_out_and_counted(
    stage: LoopbackLink,
) -> None:
    drive(stage, 4)
    stage.link.alerts.announce(LONG_CALL, "C1 unknown thing ahead 38%: go/stay/word", stage.now)
    stage.send(mavlink.MAVLink_param_request_list_message(1, 191))
    stage.send(mavlink.MAVLink_command_long_message(1, 191, 31011, 0, 0, 0, 0, 0, 0, 0, 0))
    stage.send(GO)
    stage.run(3)
    kinds = {frame.message.get_type() for frame in stage.frames}
    assert kinds >= {"HEARTBEAT", "NAMED_VALUE_FLOAT", "STATUSTEXT", "PARAM_VALUE", "COMMAND_ACK"}
    assert "TUNNEL" not in kinds
    assert stage.link.counters.connections["main"].left_out >= 5
    assert versions(stage.frames).count(2) <= 1, "but for one heartbeat"
    assert len(stage.reported(Answer)) == 1


def test_what_only_2_knows_is_cut_off(stage: LoopbackLink) -> None:
    stage.link.texts.send("x" * 50, 6, stage.now)
    stage.send(mavlink.MAVLink_command_long_message(1, 191, 31011, 0, 0, 0, 0, 0, 0, 0, 0))
    stage.run(0.5)
    lengths = {frame.message.get_type(): frame.size for frame in stage.frames}
    assert (lengths["COMMAND_ACK"], lengths["STATUSTEXT"]) == (8 + 3, 8 + 51)
    (ack,) = (
        frame.message.get_msgbuf() for frame in stage.frames if frame.message.get_type() == "COMMAND_ACK"
    )
    assert struct.unpack("<HB", ack[6:9]) == (31011, mavlink.MAV_RESULT_UNSUPPORTED)
    assert stage.sent("STATUSTEXT")[0].text == "x" * 50


def test_what_waits_when_the_version_changes_is_packed_anew() -> None:
    stage = LoopbackLink()
    stage.mavlink1 = True
    stage.run(9.5)
    stage.near.full = True
    stage.run(1.5)
    for number in range(3):
        stage.link.alerts.announce(replace(LONG_CALL, frame_id=number), f"text {number}", stage.now)
        stage.run(0.5)
    stage.near.full = False
    stage.frames.clear()
    stage.run(2)
    assert 1 in versions(stage.frames)
    assert stage.sent("TUNNEL") == []
    assert stage.sent("STATUSTEXT") != []


def test_each_connection_has_its_own_version_and_a_new_device_starts_with_2() -> None:
    wifi = ConnectionSettings("udpout:127.0.0.1:14551")
    stage = LoopbackLink(LinkSettings("udpout:127.0.0.1:14550", more={"wifi": wifi}))
    stage.mavlink1 = True
    far: Wire = stage.more["wifi"]
    far.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    stage.run(12)
    assert versions(stage.frames)[-1] == 1
    assert set(versions(far.frames)) == {2}
    stage.near.broken = True
    stage.run(0.1)
    stage.near.broken = False
    stage.frames.clear()
    stage.run(2)
    assert versions(stage.frames)[0] == 2


def test_a_mode_and_a_setpoint_reach_an_autopilot_that_speaks_1(stage: LoopbackLink) -> None:
    stage.link.modes.command(4, stage.now)
    stage.link.setpoints.on = True
    stage.run(0.5)
    assert [message.command for message in stage.sent("COMMAND_LONG")].count(176) == 1
    assert stage.sent("SET_POSITION_TARGET_LOCAL_NED") != []


def test_silence_changes_nothing() -> None:
    version = MavlinkVersion()
    old = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    old.pack(mavlink.MAVLink(None, 255, 190), force_mavlink1=True)
    version.received(old, 0.0)
    assert not version.is_1
    version.received(old, 1000.0)
    assert version.is_1
