"""The simulated PX4 rover without sockets: frames in, frames out, virtual time."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.px4 import Px4, Px4Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import Rover
from companion.sim.field.trail import Trail
from companion.vehicle import px4

TRAIL = Trail(1)
ACCEPTED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_FAILED


class Bench:
    """A PX4 rover in MISSION at speed; 191's heartbeat comes while `alive`, setpoints while `fed`."""

    def __init__(self) -> None:
        self.sent: list[tuple[float, Port, Any]] = []
        self.rover = Rover(TRAIL)
        self.now = 0.0
        self.px4 = Px4(self.rover, self._send)
        self.mavs = {
            Port.COMPANION: mavlink.MAVLink(None, 1, 191),
            Port.GCS: mavlink.MAVLink(None, 255, 190),
        }
        self.alive, self.fed = True, False
        self.tell(Port.GCS, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        self.px4.arm(on=True)
        self.px4.set_mode(Px4Mode.MISSION, "hand")
        self.run(5.0)
        self.sent.clear()

    def _send(self, port: Port, frame: bytes) -> bool:
        self.sent += [(self.now, port, parsed) for parsed in DatagramParser().frames(frame)]
        return True

    def tell(self, port: Port, message: Any) -> None:
        for frame in DatagramParser().frames(bytes(message.pack(self.mavs[port]))):
            self.px4.receive(port, frame)

    def command(self, number: int, *params: float) -> list[int]:
        """The results that the companion hears."""
        before = len(self.sent)
        filled = [*params, *[0.0] * (7 - len(params))]
        self.tell(Port.COMPANION, mavlink.MAVLink_command_long_message(1, 1, number, 0, *filled))
        return [int(m.result) for _, _, m in self.sent[before:] if m.get_type() == "COMMAND_ACK"]

    def ask(self, mode: int) -> list[int]:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            step = round(self.now / 0.02)
            if self.alive and step % 50 == 0:
                self.tell(Port.COMPANION, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
            if self.fed and step % 10 == 0:
                self.feed()
            self.rover.step(0.02)
            self.px4.poll(self.now)
            self.now += 0.02

    def feed(self, speed: float = 0.0) -> None:
        """One setpoint."""
        zeros = [0.0] * 7
        setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x0DC7, 0.0, 0.0, 0.0, speed, *zeros
        )
        self.tell(Port.COMPANION, setpoint)

    def heard(self, kind: str, port: Port = Port.COMPANION) -> list[tuple[float, Any]]:
        return [(at, m) for at, where, m in self.sent if where is port and m.get_type() == kind]

    def offboard(self) -> None:
        """Held in OFFBOARD."""
        self.fed = True
        self.run(0.6)
        self.ask(Px4Mode.OFFBOARD)
        assert self.px4.mode is Px4Mode.OFFBOARD


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_its_modes_are_those_that_the_companion_knows() -> None:
    assert {int(mode) for mode in Px4Mode} <= set(px4.LOITERING.names)
    assert (Px4Mode.MISSION, Px4Mode.LOITER, Px4Mode.OFFBOARD) == (px4.MISSION, px4.LOITER, px4.OFFBOARD)


def test_a_mode_is_acknowledged_twice_in_either_order(bench: Bench) -> None:
    first, second = bench.ask(Px4Mode.LOITER), bench.ask(Px4Mode.MISSION)
    assert sorted(first) == sorted(second)
    assert first == second[::-1]
    assert ACCEPTED in first


@pytest.mark.parametrize("mode", [0x0009_0000, 0x0904_0000])
def test_a_mode_that_it_does_not_have_is_refused(bench: Bench, mode: int) -> None:
    assert FAILED in bench.ask(mode)
    assert bench.px4.mode is Px4Mode.MISSION


def test_the_heartbeat_is_px4s_and_tells_a_change_only_when_its_second_is_over(bench: Bench) -> None:
    bench.run(0.5)
    bench.ask(Px4Mode.LOITER)
    asked_at = bench.now
    bench.run(3.0)
    beats = bench.heard("HEARTBEAT")
    assert {(m.type, m.autopilot) for _, m in beats} == {(10, 12)}
    gaps = [later - earlier for (earlier, _), (later, _) in pairwise(beats)]
    assert all(0.9 < gap < 1.1 for gap in gaps)
    told_at = next(at for at, m in beats if m.custom_mode == Px4Mode.LOITER)
    assert 0.1 < told_at - asked_at <= 1.0


def test_current_mode_tells_it_sooner_where_it_is_asked_for(bench: Bench) -> None:
    bench.run(2.0)
    assert bench.heard("CURRENT_MODE") == []
    bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 436, 200_000)
    bench.run(0.3)
    bench.ask(Px4Mode.LOITER)
    asked_at = bench.now
    bench.run(1.0)
    told_at = next(at for at, m in bench.heard("CURRENT_MODE") if m.custom_mode == Px4Mode.LOITER)
    assert told_at - asked_at <= 0.2
    assert bench.heard("CURRENT_MODE", Port.GCS) == []


def test_loiter_runs_on_turns_and_drives_back_to_the_point(bench: Bench) -> None:
    x, y, before = bench.rover.x, bench.rover.y, bench.rover.distance
    bench.ask(Px4Mode.LOITER)
    farthest = 0.0
    for _ in range(200):
        bench.run(0.1)
        farthest = max(farthest, math.hypot(bench.rover.x - x, bench.rover.y - y))
    assert bench.rover.speed == 0.0
    assert 2.4 < farthest < 4.5
    assert 5.0 < bench.rover.distance - before < 11.0
    assert math.hypot(bench.rover.x - x, bench.rover.y - y) < 0.8


def test_from_loiter_the_mission_goes_on(bench: Bench) -> None:
    bench.ask(Px4Mode.LOITER)
    bench.run(20.0)
    stood_at = bench.rover.s
    bench.ask(Px4Mode.MISSION)
    bench.run(6.0)
    assert 3.0 < (bench.rover.s - stood_at) % TRAIL.length < 16.0


def test_offboard_is_refused_without_setpoints(bench: Bench) -> None:
    assert FAILED in bench.ask(Px4Mode.OFFBOARD)
    bench.feed()
    assert FAILED in bench.ask(Px4Mode.OFFBOARD)
    assert bench.px4.mode is Px4Mode.MISSION


def test_a_setpoint_that_says_drive_counts_as_none(bench: Bench) -> None:
    for _ in range(10):
        bench.feed(1.0)
        bench.run(0.1)
    assert FAILED in bench.ask(Px4Mode.OFFBOARD)


def test_zero_velocity_stops_it_on_the_spot(bench: Bench) -> None:
    bench.offboard()
    before, since = bench.rover.distance, bench.now
    while bench.rover.speed > 0.02:
        bench.run(0.02)
    assert bench.now - since == pytest.approx(1.9, abs=0.3)
    assert bench.rover.distance - before < 3.0
    bench.run(10.0)
    assert (bench.px4.mode, bench.rover.speed) == (Px4Mode.OFFBOARD, 0.0)


@pytest.mark.parametrize(("action", "mode", "drives"), [(0, Px4Mode.RTL, True), (5, Px4Mode.LOITER, False)])
def test_setpoints_that_stop_end_as_the_owner_has_set(
    bench: Bench, action: int, mode: Px4Mode, *, drives: bool
) -> None:
    bench.px4.set_parameter("COM_OBL_RC_ACT", action)
    bench.offboard()
    bench.run(5.0)
    bench.fed = False
    bench.run(3.0)
    assert bench.px4.mode is mode
    assert (bench.rover.speed > 0.5) is drives
    assert bench.px4.mode_log[-1].by == "autopilot"


def test_rtl_drives_home_and_stays(bench: Bench) -> None:
    bench.px4.set_mode(Px4Mode.RTL, "hand")
    bench.run(120.0)
    home = TRAIL.pose(TRAIL.start)
    assert bench.rover.speed == 0.0
    assert math.hypot(bench.rover.x - home.x, bench.rover.y - home.y) < 1.0


def test_without_the_companion_it_says_so_once_and_drives_on(bench: Bench) -> None:
    bench.alive = False
    gone_at = bench.now
    bench.run(20.0)
    texts = bench.heard("STATUSTEXT", Port.GCS)
    assert [m.text for _, m in texts] == ["Connection to mission computer lost"]
    assert texts[0][0] - gone_at == pytest.approx(6.9, abs=1.1)
    assert bench.px4.mode is Px4Mode.MISSION
    assert bench.rover.speed > 1.0


def test_it_forwards_only_where_both_links_are_set_to(bench: Bench) -> None:
    text = mavlink.MAVLink_statustext_message(3, b"C7 unknown thing ahead")
    bench.tell(Port.COMPANION, text)
    assert len(bench.heard("STATUSTEXT", Port.GCS)) == 1
    bench.px4.set_parameter("MAV_1_FORWARD", 0)
    bench.tell(Port.COMPANION, text)
    assert len(bench.heard("STATUSTEXT", Port.GCS)) == 1


def test_a_px4_rover_has_no_reversed_mission() -> None:
    bench = Bench()
    assert bench.command(mavlink.MAV_CMD_DO_SET_REVERSE, 1) == [mavlink.MAV_RESULT_UNSUPPORTED]
    bench.run(4.0)
    assert bench.rover.speed > 1.0
