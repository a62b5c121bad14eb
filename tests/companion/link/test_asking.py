"""What is asked of the autopilot: streams, on our own port, again while they stay away."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

from companion.link.heard import Pulses
from companion.link.rehearsal import Rehearsal

POSITION, PULSES = 33, 65


def asked(stage: Rehearsal, message_id: int) -> list[float]:
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
    stage = Rehearsal()
    stage.run(12.0)
    assert asked(stage, PULSES) == []
    assert asked(stage, POSITION) == [0.0, 10.0]


def test_the_remote_control_is_asked_for_until_it_comes_and_again_when_it_falls_silent() -> None:
    stage = Rehearsal()
    stage.link.ask_for_pulses()
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
    stage = Rehearsal()
    stage.link.ask_for_pulses()
    stage.run(1.0)
    stage.send(pulses(1500), (1, 1))
    stage.vehicle = None
    stage.run(5.0)
    stage.vehicle, stage._heartbeat_at = 1, 0.0
    before = len(asked(stage, PULSES)), len(asked(stage, POSITION))
    stage.run(0.2)
    assert (len(asked(stage, PULSES)), len(asked(stage, POSITION))) == (before[0] + 1, before[1] + 1)


def test_what_the_remote_control_says_is_reported() -> None:
    stage = Rehearsal()
    stage.run(0.1)
    stage.send(pulses(1900), (1, 1))
    stage.run(0.1)
    (told,) = stage.reported(Pulses)
    assert (told.of(7), told.of(16), told.of(17)) == (1900, 1500, None)


def test_a_channel_without_a_pulse_that_makes_sense_is_not_known() -> None:
    for width in (0, 65535, 799, 2201):
        assert Pulses((1500,) * 6 + (width,), 16).of(7) is None
    assert Pulses((1500,) * 18, 0).of(7) is None, "the receiver has no channels"


def test_another_vehicles_remote_control_is_not_ours() -> None:
    stage = Rehearsal()
    stage.run(0.1)
    stage.send(pulses(1900), (2, 1))
    stage.send(pulses(1900), (1, 190))
    stage.run(0.1)
    assert stage.reported(Pulses) == []


def test_a_mode_that_is_not_wanted_any_more_is_not_sent() -> None:
    stage = Rehearsal()
    stage.run(0.1)
    stage.link.set_mode(4, stage.now)
    stage.link.forget_mode()
    stage.run(1.0)
    assert [message for message in stage.sent("COMMAND_LONG") if message.command == 176] == []
