"""What is asked of the autopilot: streams, on our own port, again while they stay away."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

from companion.link.inbound import RcChannels
from companion.sim.loopback_link import LoopbackLink

POSITION, PULSES = 33, 65


def asked(stage: LoopbackLink, message_id: int) -> list[float]:
    """When SET_MESSAGE_INTERVAL for this message left, to 0.1 s."""
    return [
        round(frame.at, 1)
        for frame in stage.frames
        if frame.message.get_type() == "COMMAND_LONG" and frame.message.param1 == message_id
    ]


def pulses(seventh: int, count: int = 16) -> mavlink.MAVLink_rc_channels_message:
    widths = [1500] * 18
    widths[6] = seventh
    return mavlink.MAVLink_rc_channels_message(0, count, *widths, 255)


def test_the_remote_control_is_not_asked_for_unless_somebody_wants_it() -> None:
    stage = LoopbackLink()
    stage.run(12.0)
    assert asked(stage, PULSES) == []
    assert asked(stage, POSITION) == [0.0, 10.0]


def test_the_remote_control_is_asked_for_until_it_comes_and_again_when_it_falls_silent() -> None:
    stage = LoopbackLink()
    stage.link.request_rc_channels()
    stage.run(5.0)
    assert asked(stage, PULSES) == [0.1, 2.0, 4.0]
    first = next(message for message in stage.sent("COMMAND_LONG") if message.param1 == PULSES)
    assert (first.command, first.param2, first.target_component) == (511, 200_000, 1)
    for _ in range(50):
        stage.send(pulses(1500), (1, 1))
        stage.run(0.2)
    assert asked(stage, PULSES) == [0.1, 2.0, 4.0]
    stage.run(1.5)
    assert len(asked(stage, PULSES)) == 4


def test_an_autopilot_that_comes_back_is_asked_at_once() -> None:
    stage = LoopbackLink()
    stage.link.request_rc_channels()
    stage.run(1.0)
    stage.send(pulses(1500), (1, 1))
    stage.vehicle = None
    stage.run(5.0)
    stage.vehicle, stage._heartbeat_at = 1, 0.0
    before = len(asked(stage, PULSES)), len(asked(stage, POSITION))
    stage.run(0.2)
    assert (len(asked(stage, PULSES)), len(asked(stage, POSITION))) == (before[0] + 1, before[1] + 1)


def test_what_the_remote_control_says_is_reported() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.send(pulses(1900), (1, 1))
    stage.run(0.1)
    (told,) = stage.reported(RcChannels)
    assert (told.of(7), told.of(16), told.of(17)) == (1900, 1500, None)


def test_a_channel_without_a_pulse_that_makes_sense_is_not_known() -> None:
    for width in (0, 65535, 799, 2201):
        assert RcChannels((1500,) * 6 + (width,), 16).of(7) is None
    assert RcChannels((1500,) * 18, 0).of(7) is None, "the receiver has no channels"


def test_another_vehicles_remote_control_is_not_ours() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.send(pulses(1900), (2, 1))
    stage.send(pulses(1900), (1, 190))
    stage.run(0.1)
    assert stage.reported(RcChannels) == []


def test_a_mode_that_is_not_wanted_any_more_is_not_sent() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    stage.link.modes.command(4, stage.now)
    stage.link.modes.cancel()
    stage.run(1.0)
    assert [message for message in stage.sent("COMMAND_LONG") if message.command == 176] == []


def health(present: int, enabled: int, healthy: int) -> mavlink.MAVLink_sys_status_message:
    return mavlink.MAVLink_sys_status_message(present, enabled, healthy, 0, 12000, -1, -1, 0, 0, 0, 0, 0, 0)


def known(stage: LoopbackLink, *messages: mavlink.MAVLink_message, wait: float = 0.1) -> list[int | None]:
    """What is known of the switch from each pulse among these messages."""
    before = len(stage.reported(RcChannels))
    for message in messages:
        stage.send(message, (1, 1))
        stage.run(wait)
    return [told.of(7) for told in stage.reported(RcChannels)[before:]]


RECEIVER = 0x10000


def test_pulses_that_are_repeated_with_the_transmitter_gone_are_not_known() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    gone, back = health(RECEIVER, RECEIVER, 0xFFFF), health(RECEIVER, RECEIVER, RECEIVER)
    assert known(stage, pulses(1900), gone, pulses(1900), back, pulses(1900)) == [1900, None, 1900]
    assert known(stage, gone, pulses(1900)) == [None]
    stage.run(5.1)
    assert known(stage, pulses(1900)) == [1900], "it is told no more"


def test_an_autopilot_that_tells_nothing_of_the_receiver_is_believed() -> None:
    stage = LoopbackLink()
    stage.run(0.1)
    for silent in (health(0, 0, 0), health(RECEIVER, 0, 0), health(0xFFFF, 0xFFFF, 0)):
        assert known(stage, silent, pulses(1900)) == [1900]


def test_a_strength_that_falls_to_nothing_is_a_transmitter_gone() -> None:
    def heard(strength: int) -> mavlink.MAVLink_rc_channels_message:
        return mavlink.MAVLink_rc_channels_message(0, 16, *[1900] * 18, strength)

    stage = LoopbackLink()
    stage.run(0.1)
    assert known(stage, heard(0), heard(0)) == [1900, 1900], "nobody measures it"
    assert known(stage, heard(255), heard(0)) == [1900, 1900], "nor here"
    assert known(stage, heard(90), heard(0), heard(1)) == [1900, None, 1900]


def test_the_receivers_health_is_asked_for_with_the_pulses() -> None:
    stage = LoopbackLink()
    stage.run(5.0)
    assert asked(stage, 1) == []
    stage.link.request_rc_channels()
    stage.run(4.0)
    assert len(asked(stage, 1)) == 1
    for _ in range(30):
        stage.send(health(0, 0, 0), (1, 1))
        stage.run(1.0)
    assert len(asked(stage, 1)) == 1
    stage.run(4.0)
    assert len(asked(stage, 1)) == 2
