"""Off by a channel of the remote control or by command: one thing, whoever says it."""

from __future__ import annotations

import json

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.wire.ids import Policy
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, MakeRig, Rig

ON, OFF, NO_PULSE = 1100, 1900, 0


@pytest.fixture
def switched(make_rig: MakeRig) -> Rig:
    """Allowed to hold, with the off switch on channel 7, on."""
    rig = make_rig(switch=ON)
    rig.see(1.0)
    return rig


def command(rig: Rig, policy: Policy) -> None:
    """MAV_CMD_USER_1 from the ground."""
    rig.stage.send(mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 0, 5, policy, 0, 0, 0, 0))


def acks(rig: Rig) -> list[int]:
    return [ack.result for ack in rig.stage.sent("COMMAND_ACK") if ack.command == 31010]


def modes(rig: Rig) -> list[int]:
    return [int(one.param2) for one in rig.stage.sent("COMMAND_LONG") if one.command == 176]


@pytest.mark.slow
def test_the_switch_drops_the_hold_closes_the_call_and_leaves_the_rover_as_it_is(switched: Rig) -> None:
    switched.see(3.0, "drum")
    assert (switched.state, switched.stage.mode) == (("CALLING", 1), HOLD)
    commanded = modes(switched)
    switched.switch = OFF
    switched.see(3.0, "drum")
    switched.see(20.0)
    assert switched.state == ("OFF", 0)
    assert modes(switched) == commanded, "never resumed by us"
    assert "Companion policy: off (by RC7)" in switched.texts
    assert "C1 let go: drive on by hand" in switched.texts
    assert switched.texts.count("Companion OFF by RC7: nobody watches the trail") == 2
    assert switched.echoes("AT_POLICY")[-1] == Policy.OFF


def test_the_heartbeat_tells_the_policy_in_force_at_once(switched: Rig) -> None:
    switched.see(1.0)
    told = [switched.told_policy]
    for policy in (Policy.SHADOW, Policy.OFF, Policy.REPORT):
        command(switched, policy)
        switched.see(0.5)
        told.append(switched.told_policy)
    switched.switch = OFF
    switched.see(1.0)
    assert [*told, switched.told_policy] == [
        Policy.HOLD, Policy.SHADOW, Policy.OFF, Policy.REPORT, Policy.OFF
    ]  # fmt: skip


def test_one_bad_frame_of_the_remote_control_does_nothing(switched: Rig) -> None:
    switched.switch = OFF
    switched.see(0.2)
    switched.switch = ON
    switched.see(3.0)
    assert switched.state == ("OK", 0)
    assert not any("OFF" in text for text in switched.texts)


@pytest.mark.slow
def test_switched_on_again_the_configured_policy_begins_with_nothing_open(switched: Rig) -> None:
    switched.see(3.0, "drum")
    switched.switch = OFF
    switched.see(3.0, "drum")
    switched.switch, switched.stage.mode = ON, AUTO
    switched.see(3.0)
    assert switched.state == ("OK", 0)
    assert "Companion policy: hold (by RC7)" in switched.texts
    switched.see(3.0, "drum")
    assert (switched.state, switched.stage.mode) == (("CALLING", 2), HOLD)


@pytest.mark.slow
@pytest.mark.parametrize("policy", [Policy.REPORT, Policy.SHADOW, Policy.HOLD])
def test_no_command_switches_on_what_the_remote_control_switched_off(switched: Rig, policy: Policy) -> None:
    switched.switch = OFF
    switched.see(2.0)
    command(switched, policy)
    switched.see(1.0)
    switched.set("AT_POLICY", float(policy))
    switched.see(1.0)
    assert switched.state == ("OFF", 0)
    assert acks(switched) == [mavlink.MAV_RESULT_FAILED]
    assert switched.echoes("AT_POLICY")[-1] == Policy.OFF
    assert "Refused: RC7 says off, switch it on there" in switched.texts


def test_off_by_both_stays_off_until_both_say_on(switched: Rig) -> None:
    command(switched, Policy.OFF)
    switched.see(1.0)
    assert acks(switched) == [mavlink.MAV_RESULT_ACCEPTED]
    switched.switch = OFF
    switched.see(2.0)
    switched.switch = ON
    switched.see(2.0)
    assert switched.state == ("OFF", 0)
    assert "RC7 is on, 255/190 said off: set AT_POLICY" in switched.texts
    command(switched, Policy.HOLD)
    switched.see(1.0)
    assert switched.state == ("OK", 0)


@pytest.mark.slow
def test_a_switch_that_falls_silent_changes_nothing_and_is_said_again_and_again(switched: Rig) -> None:
    switched.switch = NO_PULSE
    switched.see(70.0)
    assert switched.state == ("OK", 0)
    assert switched.texts.count("Off switch RC7 not heard: stays on") >= 2
    switched.see(3.0, "drum")
    assert switched.stage.mode == HOLD, "what was allowed stays allowed"


@pytest.mark.slow
def test_a_switch_is_said_only_when_it_falls_silent_and_when_it_is_back(switched: Rig) -> None:
    switched.see(10.0)
    assert not [text for text in switched.texts if text.startswith("Off switch")]
    switched.switch = NO_PULSE
    switched.see(8.0)
    switched.switch = ON
    switched.see(8.0)
    said = [text for text in switched.texts if text.startswith("Off switch")]
    assert said[-1] == "Off switch RC7 heard: on"
    assert said.count("Off switch RC7 heard: on") == 1
    assert set(said[:-1]) == {"Off switch RC7 not heard: stays on"}


@pytest.mark.slow
def test_a_switch_that_falls_silent_while_off_stays_off(switched: Rig) -> None:
    switched.switch = OFF
    switched.see(2.0)
    switched.switch = NO_PULSE
    switched.see(10.0, "drum")
    assert switched.state == ("OFF", 0)
    assert "Off switch RC7 not heard: stays OFF" in switched.texts
    switched.switch = OFF
    switched.see(2.0)
    assert "Off switch RC7 heard: OFF" in switched.texts


def test_a_switch_that_was_never_heard_is_said(make_rig: MakeRig) -> None:
    rig = make_rig(switch=NO_PULSE)
    rig.see(5.0)
    assert "Off switch RC7 not heard: stays on" in rig.texts
    assert rig.daemon.status.figures()["switches"] == {
        "in_force": "hold",
        "off_by": None,
        "switch": "RC7",
        "switch_us": None,
        "switch_heard": False,
    }


def test_off_outlives_kill_9_before_anything_is_heard(switched: Rig) -> None:
    switched.switch = OFF
    switched.see(2.0)
    switched.switch = NO_PULSE
    switched.restart()
    switched.see(4.0, "drum")
    assert switched.state == ("OFF", 0)
    assert modes(switched) == []
    switched.switch = ON
    switched.see(3.0, "drum")
    assert switched.state[0] == "CALLING"


def test_off_by_command_outlives_kill_9_and_is_acknowledged_only_when_it_is_kept(rig: Rig) -> None:
    command(rig, Policy.OFF)
    while not acks(rig):
        rig.step(None)
    rig.restart()
    rig.see(2.0, "drum")
    assert rig.state == ("OFF", 0)
    assert "Companion OFF by 255/190: nobody watches the trail" in rig.texts
    command(rig, Policy.HOLD)
    rig.see(2.0, "drum")
    asked = rig.state
    rig.restart()
    rig.see(0.5, "drum")
    assert asked[0] == "CALLING"
    assert rig.state == asked


def test_a_mode_on_its_way_to_the_autopilot_is_caught_by_the_switch(rig: Rig) -> None:
    for number in range(3):
        rig.stage.link.texts.send(f"ahead {number}", 1, rig.clock.now)
    rig.stage.link.modes.command(HOLD, rig.clock.now)
    command(rig, Policy.OFF)
    rig.see(2.0)
    assert modes(rig) == []


def test_a_mode_on_its_way_to_the_autopilot_is_caught_by_a_human(held: Rig) -> None:
    before = modes(held)
    held.stage.link.modes.command(HOLD, held.clock.now)
    held.stage.mode = MANUAL
    held.stage.heartbeat(1)
    held.see(2.0)
    assert modes(held) == before


def test_the_status_file_says_who_switched_off(rig: Rig) -> None:
    rig.set("AT_POLICY", float(Policy.OFF))
    rig.see(0.3)
    rig.daemon.write_status()
    rig.writer.drain()
    status = json.loads((rig.folder / "status.json").read_text())
    assert status["switches"] == {"in_force": "off", "off_by": "255/190"}
    assert status["policy"] == "off"


@pytest.mark.parametrize("has_switch", [True, False])
def test_the_remote_control_is_asked_for_where_a_switch_is_configured_alone(
    make_rig: MakeRig, has_switch: bool
) -> None:
    rig = make_rig(switch=ON if has_switch else None)
    rig.switch = None  # it tells nothing of itself
    rig.see(3.0)
    asked = {one.param1 for one in rig.stage.sent("COMMAND_LONG") if one.command == 511}
    assert (mavlink.MAVLINK_MSG_ID_RC_CHANNELS in asked) is has_switch
