"""What the simulated PX4 does when a stream of MANUAL_CONTROL ends, by its parameters."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.px4 import Px4, Px4Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail

TRAIL = Trail(1)
STEP = 0.02
GUARDED = {"COM_RC_IN_MODE": 1.0, "COM_RC_LOSS_T": 0.5, "COM_FAIL_ACT_T": 0.0, "NAV_RCL_ACT": 1.0}


class Bench:
    """A PX4 rover in MISSION; the companion's MANUAL_CONTROL comes ten times a second while `streams`."""

    def __init__(self, *, streams: bool = True, **parameters: float) -> None:
        self.rover = Rover(TRAIL)
        self.px4 = Px4(self.rover, self._send)
        self.texts: list[str] = []
        self.pulses: list[Any] = []
        self.streams = streams
        self.now = 0.0
        self._mav = mavlink.MAVLink(None, 1, 191)
        for name, value in {**GUARDED, **parameters}.items():
            row = self.px4.set_parameter(name, value)
            assert row is not None
            assert row.value == value
        self.px4.arm(on=True)
        self.px4.set_mode(Px4Mode.MISSION, "hand")
        self.run(2.0)

    def _send(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            for message in DatagramParser().frames(frame):
                self.texts += [message.text] if message.get_type() == "STATUSTEXT" else []
                self.pulses += [message] if message.get_type() == "RC_CHANNELS" else []
        return True

    def tell(self, message: Any) -> None:
        for frame in DatagramParser().frames(bytes(message.pack(self._mav))):
            self.px4.receive(Port.COMPANION, frame)

    def sticks(self, target: int = 1) -> None:
        self.tell(mavlink.MAVLink_manual_control_message(target, 0, 0, 500, 0, 0))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            if self.streams and round(self.now / STEP) % 5 == 0:
                self.sticks()
            self.rover.step(STEP)
            self.px4.poll(self.now)
            self.now += STEP

    def seconds_until(self, mode: Px4Mode, within: float = 10.0) -> float:
        began = self.now
        while self.px4.mode is not mode:
            assert self.now - began < within, f"still {self.px4.mode!r}"
            self.run(STEP)
        return self.now - began

    def ask(self, mode: Px4Mode) -> None:
        params = (1, int(mode) >> 16 & 0xFF, int(mode) >> 24, 0, 0, 0, 0)
        self.tell(mavlink.MAVLink_command_long_message(1, 1, 176, 0, *params))


def test_a_stream_that_ends_holds_a_mission_after_half_a_second_and_it_says_so() -> None:
    bench = Bench()
    assert bench.px4.mode.name == "MISSION"
    bench.streams = False
    assert 0.4 <= bench.seconds_until(Px4Mode.LOITER) <= 0.6
    assert "Manual control lost" in bench.texts
    assert bench.px4.mode_log[-1].by == "autopilot"
    bench.run(20.0)
    assert bench.rover.speed == 0.0


def test_a_stream_that_comes_back_lets_nothing_drive_on_until_a_mode_is_set() -> None:
    bench = Bench()
    bench.streams = False
    bench.run(2.0)
    bench.streams = True
    bench.run(5.0)
    assert bench.px4.mode.name == "LOITER"
    bench.ask(Px4Mode.MISSION)
    bench.run(5.0)
    assert bench.px4.mode.name == "MISSION"
    bench.streams = False
    bench.seconds_until(Px4Mode.LOITER, 1.0)


@pytest.mark.parametrize("mode", [Px4Mode.MISSION, Px4Mode.RTL])
def test_a_mode_that_is_set_while_the_stream_is_away_takes_over(mode: Px4Mode) -> None:
    bench = Bench()
    bench.streams = False
    bench.run(2.0)
    bench.ask(mode)
    bench.run(5.0)
    assert bench.px4.mode.name == mode.name


def test_the_end_of_the_stream_ends_a_return_that_was_set_before() -> None:
    bench = Bench()
    bench.ask(Px4Mode.RTL)
    bench.streams = False
    assert bench.seconds_until(Px4Mode.LOITER) <= 0.6
    bench.ask(Px4Mode.RTL)
    bench.run(5.0)
    assert bench.px4.mode.name == "RTL", "set again it goes on"


def test_an_excepted_mode_goes_on_and_the_next_one_that_is_not_is_held_once() -> None:
    bench = Bench(COM_RCL_EXCEPT=2.0)
    bench.ask(Px4Mode.RTL)
    bench.streams = False
    bench.run(3.0)
    assert bench.px4.mode.name == "RTL"
    bench.ask(Px4Mode.MISSION)
    bench.run(0.5)
    assert bench.px4.mode.name == "LOITER"
    bench.ask(Px4Mode.MISSION)
    bench.run(3.0)
    assert bench.px4.mode.name == "MISSION"


@pytest.mark.parametrize(
    "parameters",
    [{"COM_RCL_EXCEPT": 1.0}, {"COM_RC_IN_MODE": 0.0}, {"COM_RC_IN_MODE": 3.0}, {"NAV_RCL_ACT": 7.0}],
)
def test_with_other_parameters_it_drives_on(parameters: dict[str, float]) -> None:
    bench = Bench(streams=True, **parameters)
    bench.streams = False
    bench.run(5.0)
    assert bench.px4.mode.name == "MISSION"


def test_a_stream_that_was_not_there_when_it_was_armed_is_no_loss_until_it_came_once() -> None:
    bench = Bench(streams=False)
    bench.run(5.0)
    assert bench.px4.mode.name == "MISSION"
    bench.sticks(target=2)
    bench.run(2.0)
    assert bench.px4.mode.name == "MISSION", "another vehicle's"
    bench.sticks()
    assert 0.4 <= bench.seconds_until(Px4Mode.LOITER) <= 0.6


def test_it_waits_in_loiter_before_it_drives_home() -> None:
    bench = Bench(NAV_RCL_ACT=2.0, COM_FAIL_ACT_T=3.0)
    bench.streams = False
    assert bench.seconds_until(Px4Mode.LOITER) <= 0.6
    assert 2.9 <= bench.seconds_until(Px4Mode.RTL) <= 3.1


def test_a_mode_of_the_sticks_needs_the_stream_and_the_transmitter_moves_nothing() -> None:
    bench = Bench()
    bench.ask(Px4Mode.POSITION)
    assert bench.px4.mode.name == "POSITION"
    bench.rover.transmitter.throttle = 1.0
    bench.run(5.0)
    assert bench.rover.speed == 0.0
    bench.streams = False
    bench.seconds_until(Px4Mode.LOITER, 1.0)
    bench.ask(Px4Mode.POSITION)
    assert bench.px4.mode.name == "LOITER", "refused"


def test_a_reboot_forgets_the_stream() -> None:
    bench = Bench()
    bench.streams = False
    bench.px4.reboot(1.0)
    bench.run(2.0)
    bench.px4.arm(on=True)
    bench.px4.set_mode(Px4Mode.MISSION, "hand")
    bench.run(5.0)
    assert bench.px4.mode.name == "MISSION"


def test_a_transmitter_that_is_off_tells_no_channels() -> None:
    bench = Bench()
    assert bench.pulses[-1].chancount > 0
    bench.rover.transmitter.on = False
    bench.run(2.0)
    assert bench.pulses[-1].chancount == 0


@pytest.mark.parametrize("sender", [Port.COMPANION, Port.GCS])
def test_sticks_for_this_vehicle_go_on_to_the_companion_and_not_to_the_radio(sender: Port) -> None:
    went: list[Port] = []

    def send(port: Port, _frame: bytes) -> bool:
        went.append(port)
        return True

    px4 = Px4(Rover(TRAIL), send)
    ids = {Port.COMPANION: (1, 191), Port.GCS: (255, 190)}
    for port, own in ids.items():
        beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, *own))
        px4.receive(port, DatagramParser().frames(bytes(beat))[0])
    went.clear()
    sticks = mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0).pack(
        mavlink.MAVLink(None, *ids[sender])
    )
    px4.receive(sender, DatagramParser().frames(bytes(sticks))[0])
    assert went == ([Port.COMPANION] if sender is Port.GCS else [])
