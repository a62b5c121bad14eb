"""How the vehicle stands and what time it has, as its autopilot tells them: checked, and asked for."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.loopback_link import LoopbackLink
from companion.vehicle.state import Vehicle

AUTOPILOT = (1, 1)
ATTITUDE, SYSTEM_TIME = 30, 2
IN_2026 = 1_790_000_000.0


def attitude(roll: float, pitch: float, yaw: float) -> mavlink.MAVLink_attitude_message:
    return mavlink.MAVLink_attitude_message(0, roll, pitch, yaw, 0.0, 0.0, 0.0)


def told(stage: LoopbackLink, message: object, sender: tuple[int, int] = AUTOPILOT) -> Vehicle:
    stage.run(0.1)
    stage.send(message, sender)
    stage.run(0.1)
    assert stage.link.vehicle is not None
    return stage.link.vehicle


def test_the_attitude_is_in_degrees_with_the_yaw_from_north() -> None:
    vehicle = told(LoopbackLink(), attitude(0.1, -0.2, -math.pi / 2))
    assert vehicle.attitude == pytest.approx((5.73, -11.46, 270.0))


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 7.0])
def test_an_attitude_that_cannot_be_is_not_taken(wrong: float) -> None:
    for angles in ((wrong, 0.0, 0.0), (0.0, wrong, 0.0), (0.0, 0.0, wrong)):
        assert told(LoopbackLink(), attitude(*angles)).attitude is None


def test_a_lean_has_the_rates_of_its_report_but_for_one_that_cannot_be() -> None:
    stage = LoopbackLink()
    told(stage, attitude(0.0, 0.0, 0.0))
    turning = mavlink.MAVLink_attitude_message(0, 0.02, 0.05, 0.0, 0.1, -0.2, 0.0)
    lean = told(stage, turning).motion
    assert lean is not None
    assert (lean.pitch, lean.bank) == pytest.approx((2.87, 1.15), rel=0.25)
    assert (lean.pitch_rate, lean.bank_rate) == pytest.approx((-11.46, 5.73), abs=0.01)
    lean = told(stage, mavlink.MAVLink_attitude_message(0, 0.02, 0.05, 0.0, math.nan, 99.0, 0.0)).motion
    assert lean is not None
    assert (lean.pitch_rate, lean.bank_rate) == (0.0, 0.0)


def test_speed_and_heading_add_up_to_a_pose() -> None:
    stage = LoopbackLink()
    told(stage, attitude(0.0, 0.0, 0.0))
    motion = None
    for _ in range(8):
        told(stage, mavlink.MAVLink_global_position_int_message(0, 1, 1, 0, 0, 150, 0, 0, 0))
        motion = told(stage, attitude(0.0, 0.0, 0.0)).motion
    assert motion is not None
    assert motion.pose is not None
    assert motion.pose.x == pytest.approx(7 * 0.4 * 1.5, abs=0.01), "`told` takes 0.2 s"
    backwards = told(stage, attitude(0.0, 0.0, math.pi)).motion
    assert backwards is not None
    assert backwards.speed == pytest.approx(-1.5, abs=0.01)


def test_a_right_turn_towards_the_east_is_one_to_the_right() -> None:
    stage, poses = LoopbackLink(), []
    for number in range(10):
        yaw = math.radians(45.0 + 9.0 * number)  # at 22.5 degrees a second, since two messages take 0.4 s
        north, east = (round(150 * way(yaw)) for way in (math.cos, math.sin))
        told(stage, mavlink.MAVLink_global_position_int_message(0, 1, 1, 0, 0, north, east, 0, 0))
        turning = mavlink.MAVLink_attitude_message(0, 0.0, 0.0, yaw, 0.5, 0.0, math.radians(22.5))
        motion = told(stage, turning).motion
        assert motion is not None
        assert motion.speed == pytest.approx(1.5, abs=0.01)
        assert motion.yaw_rate == pytest.approx(-22.5, abs=0.01)
        assert motion.pose is not None
        poses.append(motion.pose)
    first, pose = poses[0], poses[-1]
    turn = math.radians(first.heading)
    ahead, left = (pose.x - first.x), (pose.y - first.y)
    ahead, left = (
        ahead * math.cos(turn) + left * math.sin(turn),
        left * math.cos(turn) - ahead * math.sin(turn),
    )
    chord = 2 * (1.5 / math.radians(22.5)) * math.sin(math.radians(81.0) / 2)
    assert (ahead, left) == pytest.approx(
        (chord * math.cos(math.radians(40.5)), -chord * math.sin(math.radians(40.5))), abs=0.1
    )


def test_an_old_attitude_is_forgotten() -> None:
    stage = LoopbackLink()
    told(stage, attitude(0.0, 0.0, 1.0))
    stage.run(6.0)
    assert stage.link.vehicle is not None
    assert (stage.link.vehicle.attitude, stage.link.vehicle.motion) == (None, None)


def test_the_autopilots_time_goes_on_by_itself() -> None:
    stage = LoopbackLink()
    vehicle = told(stage, mavlink.MAVLink_system_time_message(int(IN_2026 * 1e6), 0))
    assert vehicle.clock is not None
    assert vehicle.clock + stage.now == pytest.approx(IN_2026 + 0.1, abs=0.15)


@pytest.mark.parametrize("seconds", [0.0, 946_684_800.0, 1_577_000_000.0, 5e9])
def test_a_time_before_the_software_or_after_the_century_is_none(seconds: float) -> None:
    message = mavlink.MAVLink_system_time_message(int(seconds * 1e6), 0)
    assert told(LoopbackLink(), message).clock is None


def test_another_vehicles_attitude_and_time_are_not_ours() -> None:
    stage = LoopbackLink()
    told(stage, attitude(0.0, 0.0, 1.0), (2, 1))
    vehicle = told(stage, mavlink.MAVLink_system_time_message(int(IN_2026 * 1e6), 0), (2, 1))
    assert (vehicle.attitude, vehicle.clock) == (None, None)


def test_both_are_asked_for_on_the_way_to_the_autopilot_until_they_come_and_when_they_stay_away() -> None:
    stage = LoopbackLink()

    def asked() -> list[float]:
        return [
            one.param1
            for one in stage.sent("COMMAND_LONG")
            if one.command == 511 and one.target_component == 1
        ]

    stage.run(1.0)
    assert {ATTITUDE, SYSTEM_TIME} <= set(asked())
    before = len(asked())
    for _ in range(20):
        told(stage, attitude(0.0, 0.0, 0.0))
        told(stage, mavlink.MAVLink_system_time_message(int(IN_2026 * 1e6), 0))
        stage.run(0.6)
    assert not {ATTITUDE, SYSTEM_TIME} & set(asked()[before:])
    stage.run(35.0)
    assert {ATTITUDE, SYSTEM_TIME} <= set(asked()[before:])


def test_a_time_since_boot_that_runs_backwards_is_a_reboot_whoever_tells_it() -> None:
    stage = LoopbackLink()
    position = mavlink.MAVLink_global_position_int_message
    later = [
        mavlink.MAVLink_system_time_message(0, 60_000),
        position(500, 470000000, 80000000, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_system_time_message(0, 20_000),
        mavlink.MAVLink_attitude_message(900, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        position(40_000, 0, 0, 0, 0, 0, 0, 0, 0),
        position(1_000, 0, 0, 0, 0, 0, 0, 0, 0),
    ]
    assert [told(stage, message).reboots for message in later] == [0, 1, 1, 2, 2, 3]


def test_messages_that_overtake_each_other_and_a_counter_that_is_used_up_are_none() -> None:
    stage = LoopbackLink()
    for at in (60_000, 57_500, 61_000, 2**32 - 500, 700):
        assert told(stage, mavlink.MAVLink_system_time_message(0, at)).reboots == 0
    assert told(stage, mavlink.MAVLink_system_time_message(0, 9_000), (2, 1)).reboots == 0
    assert told(stage, mavlink.MAVLink_system_time_message(0, 2_000), (2, 1)).reboots == 0


def hud(throttle: int) -> mavlink.MAVLink_vfr_hud_message:
    return mavlink.MAVLink_vfr_hud_message(0.0, 0.0, 0, throttle % (1 << 16), 0.0, 0.0)


@pytest.mark.parametrize(
    ("throttle", "pushes"), [(0, False), (9, False), (10, True), (-10, True), (-9, False)]
)
def test_a_throttle_forwards_or_backwards_tells_that_it_drives(throttle: int, pushes: bool) -> None:
    stage = LoopbackLink()
    vehicle = told(stage, hud(throttle))
    assert (vehicle.pushes_since is not None) is pushes
    later = told(stage, hud(50))
    assert later.pushes_since == (vehicle.pushes_since or later.throttle_at)
    assert told(stage, hud(0)).pushes_since is None


def test_an_old_throttle_is_forgotten() -> None:
    stage = LoopbackLink()
    assert told(stage, hud(50)).pushes_since is not None
    stage.run(6.0)
    assert stage.link.vehicle is not None
    assert stage.link.vehicle.pushes_since is None
