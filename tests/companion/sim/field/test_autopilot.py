"""The autopilot without sockets: frames in, frames out, virtual time."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.modes import Mode
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.rover import MotorDrive, Rover
from companion.sim.field.trail import Trail

TRAIL = Trail(1)


class Bench:
    """An autopilot with a companion (1/191) and a ground station (255/190) plugged in."""

    def __init__(self) -> None:
        self.sent: list[tuple[Port, bytes]] = []
        self.rover = Rover(TRAIL)
        self.autopilot = SimulatedAutopilot(self.rover, self._send)
        self.mavs = {
            Port.COMPANION: mavlink.MAVLink(None, 1, 191),
            Port.GCS: mavlink.MAVLink(None, 255, 190),
        }
        self.now = 0.0
        for port in Port:
            self.tell(port, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        self.pass_time(0.0)
        self.sent.clear()

    def _send(self, port: Port, frame: bytes) -> bool:
        self.sent.append((port, frame))
        return True

    def tell(self, port: Port, message: Any) -> bytes:
        raw = bytes(message.pack(self.mavs[port]))
        for frame in DatagramParser().frames(raw):
            self.autopilot.receive(port, frame)
        return raw

    def command(self, port: Port, number: int, *params: float, target: tuple[int, int] = (1, 1)) -> int:
        """The result that the sender hears."""
        self.sent.clear()
        filled = [*params, *[0.0] * (7 - len(params))]
        self.tell(port, mavlink.MAVLink_command_long_message(*target, number, 0, *filled))
        acks = [m for m in self.heard(port) if m.get_type() == "COMMAND_ACK" and m.command == number]
        assert len(acks) == 1
        assert (acks[0].target_system, acks[0].target_component) == (
            self.mavs[port].srcSystem,
            self.mavs[port].srcComponent,
        )
        return int(acks[0].result)

    def set_mode(self, port: Port, mode: int) -> int:
        return self.command(port, mavlink.MAV_CMD_DO_SET_MODE, 1, mode)

    def pass_time(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / 0.02))):
            self.rover.step(0.02)
            self.autopilot.poll(self.now)
            self.now += 0.02

    def heard(self, port: Port, kind: str = "") -> list[Any]:
        frames = [frame for at, raw in self.sent if at is port for frame in DatagramParser().frames(raw)]
        return [frame for frame in frames if kind in ("", frame.get_type())]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def arm(bench: Bench) -> None:
    assert bench.command(Port.GCS, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED


def test_its_heartbeat_is_that_of_an_ardupilot_ground_rover_once_a_second_on_both_ports(bench: Bench) -> None:
    bench.pass_time(5.0)
    for port in Port:
        beats = bench.heard(port, "HEARTBEAT")
        assert 4 <= len(beats) <= 6
        first = beats[0]
        assert (first.get_srcSystem(), first.get_srcComponent(), first.type, first.autopilot) == (1, 1, 10, 3)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_mode_change_is_in_a_heartbeat_on_both_ports_at_once(bench: Bench, mode: Mode) -> None:
    bench.autopilot.set_mode(Mode.MANUAL if mode is Mode.HOLD else Mode.HOLD, "hand")
    assert bench.set_mode(Port.GCS, mode) == mavlink.MAV_RESULT_ACCEPTED
    for port in Port:
        (beat,) = bench.heard(port, "HEARTBEAT")
        assert beat.custom_mode == mode
        assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        assert beat.system_status == (3 if mode is Mode.HOLD else 4)


def test_the_old_set_mode_message_works_and_is_acknowledged(bench: Bench) -> None:
    bench.tell(Port.GCS, mavlink.MAVLink_set_mode_message(1, 1, Mode.AUTO))
    assert bench.autopilot.mode is Mode.AUTO
    (ack,) = bench.heard(Port.GCS, "COMMAND_ACK")
    assert (ack.command, ack.result) == (mavlink.MAVLINK_MSG_ID_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)


@pytest.mark.parametrize(
    ("base", "custom", "result"),
    [
        (0, 10, mavlink.MAV_RESULT_DENIED),
        (1, 99, mavlink.MAV_RESULT_FAILED),
        (1, math.nan, mavlink.MAV_RESULT_DENIED),
        (math.inf, 10, mavlink.MAV_RESULT_DENIED),
    ],
)
def test_a_mode_that_makes_no_sense_is_refused(bench: Bench, base: float, custom: float, result: int) -> None:
    assert bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_MODE, base, custom) == result
    assert bench.autopilot.mode is Mode.HOLD


@pytest.mark.parametrize("mode", list(Mode))
def test_hold_from_the_companion_is_accepted_in_every_mode(bench: Bench, mode: Mode) -> None:
    bench.autopilot.set_mode(mode, "hand")
    assert bench.set_mode(Port.COMPANION, Mode.HOLD) == mavlink.MAV_RESULT_ACCEPTED
    assert bench.autopilot.mode is Mode.HOLD


def test_the_log_of_modes_names_who_changed_them(bench: Bench) -> None:
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.set_mode(Port.COMPANION, Mode.HOLD)
    bench.autopilot.set_mode(Mode.MANUAL, "hand")
    assert [(change.mode, change.by) for change in bench.autopilot.mode_log] == [
        (Mode.AUTO, "gcs"),
        (Mode.HOLD, "companion"),
        (Mode.MANUAL, "hand"),
    ]


def test_arming_is_told_by_the_armed_bit_and_drives_off_at_once_when_left_in_auto(bench: Bench) -> None:
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(2.0)
    assert bench.rover.speed == 0.0
    arm(bench)
    assert bench.heard(Port.GCS, "HEARTBEAT")[0].base_mode & 0x80
    bench.pass_time(2.0)
    assert bench.rover.speed > 1.0


def test_a_disarmed_rover_rolls_to_a_stop(bench: Bench) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(5.0)
    bench.command(Port.GCS, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    assert not bench.autopilot.armed
    bench.pass_time(10.0)
    assert bench.rover.speed == 0.0


@pytest.mark.parametrize("value", [2.0, -1.0, math.nan])
def test_arming_with_another_number_than_0_or_1_is_denied(bench: Bench, value: float) -> None:
    denied = bench.command(Port.GCS, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, value)
    assert denied == mavlink.MAV_RESULT_DENIED


def test_auto_goes_on_after_a_hold_at_the_place_where_it_stood(bench: Bench) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(15.0)
    bench.set_mode(Port.COMPANION, Mode.HOLD)
    bench.pass_time(9.0)
    assert bench.rover.speed == 0.0
    stood_at = bench.rover.s
    bench.set_mode(Port.COMPANION, Mode.AUTO)
    bench.pass_time(3.0)
    assert 1.0 < (bench.rover.s - stood_at) % TRAIL.length < 8.0


def test_with_mis_restart_auto_heads_for_the_start_instead(bench: Bench) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(15.0)
    bench.set_mode(Port.GCS, Mode.HOLD)
    bench.pass_time(3.0)
    bench.autopilot.set_parameter("MIS_RESTART", 1)
    start = TRAIL.pose(TRAIL.start)

    def away() -> float:
        return math.hypot(bench.rover.x - start.x, bench.rover.y - start.y)

    before = away()
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(8.0)
    assert away() < before - 3.0


@pytest.mark.parametrize("mode", [Mode.LOITER, Mode.RTL, Mode.GUIDED, Mode.HOLD])
def test_modes_without_a_way_of_their_own_stand_still(bench: Bench, mode: Mode) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(4.0)
    bench.set_mode(Port.GCS, mode)
    bench.pass_time(9.0)
    assert bench.rover.speed == 0.0


@pytest.mark.parametrize("number", [mavlink.MAV_CMD_DO_PAUSE_CONTINUE, mavlink.MAV_CMD_USER_1, 65_000])
def test_unknown_commands_are_answered_unsupported(bench: Bench, number: int) -> None:
    assert bench.command(Port.GCS, number, 1) == mavlink.MAV_RESULT_UNSUPPORTED


def test_a_command_for_every_component_is_obeyed_too(bench: Bench) -> None:
    result = bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_MODE, 1, Mode.AUTO, target=(1, 0))
    assert result == mavlink.MAV_RESULT_ACCEPTED
    assert bench.autopilot.mode is Mode.AUTO


def test_a_command_int_is_obeyed_like_a_command_long(bench: Bench) -> None:
    number = mavlink.MAV_CMD_DO_SET_MODE
    bench.tell(
        Port.GCS, mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, 1, Mode.AUTO, 0, 0, 0, 0, 0)
    )
    assert bench.autopilot.mode is Mode.AUTO


def test_what_is_meant_for_the_companion_goes_there_unchanged_and_is_not_obeyed(bench: Bench) -> None:
    arm_it = mavlink.MAVLink_command_long_message(1, 191, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[1.0] * 7)
    bench.mavs[Port.GCS].seq = 77
    raw = bench.tell(Port.GCS, arm_it)
    assert bench.sent == [(Port.COMPANION, raw)]
    assert not bench.autopilot.armed


def test_a_signed_frame_is_passed_on_with_its_signature(bench: Bench) -> None:
    bench.mavs[Port.GCS].signing.secret_key = bytes(range(32))
    bench.mavs[Port.GCS].signing.sign_outgoing = True
    raw = bench.tell(Port.GCS, mavlink.MAVLink_param_request_list_message(1, 191))
    assert raw[2] & mavlink.MAVLINK_IFLAG_SIGNED
    assert bench.sent == [(Port.COMPANION, raw)]


def test_a_tunnel_to_the_autopilot_itself_ends_there(bench: Bench) -> None:
    bench.tell(Port.COMPANION, mavlink.MAVLink_tunnel_message(1, 1, 45001, 3, bytes(128)))
    assert bench.sent == []


def test_the_companion_s_bytes_that_reach_the_radio_are_counted_and_nobody_else_s(bench: Bench) -> None:
    before = bench.autopilot.bytes_from_companion
    raw = bench.tell(Port.COMPANION, mavlink.MAVLink_statustext_message(3, b"C7 unknown thing ahead"))
    bench.tell(Port.GCS, mavlink.MAVLink_statustext_message(6, b"from the ground"))
    bench.pass_time(2.0)
    assert bench.autopilot.bytes_from_companion == before + len(raw)


def test_its_own_sequence_numbers_count_up_on_each_port(bench: Bench) -> None:
    bench.pass_time(3.0)
    for port in Port:
        numbers = [frame.get_seq() for frame in bench.heard(port)]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_all_parameters_are_listed_only_to_who_asked_and_paced(bench: Bench) -> None:
    bench.tell(Port.COMPANION, mavlink.MAVLink_param_request_list_message(1, 0))
    bench.pass_time(0.2)
    assert len(bench.heard(Port.COMPANION, "PARAM_VALUE")) <= 11
    bench.pass_time(2.0)
    rows = bench.heard(Port.COMPANION, "PARAM_VALUE")
    assert [row.param_index for row in rows] == list(range(len(bench.autopilot.parameters)))
    assert {row.param_count for row in rows} == {len(rows)}
    assert {"MIS_RESTART", "CRUISE_SPEED"} <= {row.param_id for row in rows}
    assert bench.heard(Port.GCS, "PARAM_VALUE") == []


def test_a_parameter_is_read_by_name_and_by_index(bench: Bench) -> None:
    bench.tell(Port.GCS, mavlink.MAVLink_param_request_read_message(1, 1, b"CRUISE_SPEED", -1))
    (by_name,) = bench.heard(Port.GCS, "PARAM_VALUE")
    bench.sent.clear()
    bench.tell(Port.GCS, mavlink.MAVLink_param_request_read_message(1, 1, b"", by_name.param_index))
    (by_index,) = bench.heard(Port.GCS, "PARAM_VALUE")
    assert by_name.param_id == by_index.param_id == "CRUISE_SPEED"
    assert by_index.param_value == 2.5


def test_a_parameter_set_is_told_on_both_ports_and_changes_the_cruise(bench: Bench) -> None:
    bench.tell(Port.GCS, mavlink.MAVLink_param_set_message(1, 1, b"CRUISE_SPEED", 1.5, 9))
    assert [bench.heard(port, "PARAM_VALUE")[0].param_value for port in Port] == [1.5, 1.5]
    assert bench.rover.cruise_speed == 1.5


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 1e9])
def test_a_senseless_value_is_answered_with_the_old_one(bench: Bench, value: float) -> None:
    bench.tell(Port.GCS, mavlink.MAVLink_param_set_message(1, 1, b"CRUISE_SPEED", value, 9))
    assert bench.heard(Port.GCS, "PARAM_VALUE")[0].param_value == 2.5


def test_unknown_parameters_are_met_with_silence(bench: Bench) -> None:
    bench.tell(Port.GCS, mavlink.MAVLink_param_set_message(1, 1, b"AT_W_DRUM", 1.0, 9))
    bench.tell(Port.GCS, mavlink.MAVLink_param_request_read_message(1, 1, b"", 999))
    assert bench.sent == []


def test_a_message_interval_counts_on_the_asking_port_only(bench: Bench) -> None:
    number = mavlink.MAVLINK_MSG_ID_ATTITUDE
    ok = bench.command(Port.COMPANION, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 50_000)
    assert ok == mavlink.MAV_RESULT_ACCEPTED
    bench.sent.clear()
    bench.pass_time(2.0)
    assert len(bench.heard(Port.COMPANION, "ATTITUDE")) > 2 * len(bench.heard(Port.GCS, "ATTITUDE"))
    bench.command(Port.COMPANION, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, -1)
    bench.sent.clear()
    bench.pass_time(2.0)
    assert bench.heard(Port.COMPANION, "ATTITUDE") == []


def test_positions_and_attitude_agree_with_the_rover(bench: Bench) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    bench.pass_time(10.0)
    first = bench.heard(Port.GCS, "GLOBAL_POSITION_INT")[-2]
    last = bench.heard(Port.GCS, "GLOBAL_POSITION_INT")[-1]
    north = (last.lat - first.lat) * 1e-7 * 111_320
    east = (last.lon - first.lon) * 1e-7 * 111_320 * math.cos(math.radians(47))
    assert math.hypot(north, east) == pytest.approx(2.5 * 0.26, abs=0.1)
    yaw = bench.heard(Port.GCS, "ATTITUDE")[-1].yaw
    assert math.atan2(east, north) == pytest.approx(yaw, abs=0.1)
    assert math.hypot(last.vx, last.vy) == pytest.approx(250, abs=5)


def test_the_switches_of_the_hand_are_seen_in_rc_channels(bench: Bench) -> None:
    bench.rover.transmitter.switches[7] = 1900
    bench.pass_time(1.5)
    assert bench.heard(Port.COMPANION, "RC_CHANNELS")[-1].chan7_raw == 1900


numbers = st.floats(width=32)
KNOWN_COMMANDS = (176, 400, 511, 512, 520, 245, 193)


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(number=st.sampled_from(KNOWN_COMMANDS) | st.integers(0, 65_535), first=numbers, second=numbers)
def test_every_command_with_any_numbers_gets_one_acknowledgement(
    number: int, first: float, second: float
) -> None:
    bench = Bench()
    assert bench.command(Port.GCS, number, first, second) in range(10)
    bench.pass_time(1.2)
    assert bench.heard(Port.GCS, "HEARTBEAT")


@settings(max_examples=100, deadline=None)
@given(name=st.binary(max_size=16), index=st.integers(-32_768, 32_767), value=numbers)
def test_any_bytes_as_a_parameter_s_name_are_survived(name: bytes, index: int, value: float) -> None:
    bench = Bench()
    bench.tell(Port.GCS, mavlink.MAVLink_param_set_message(1, 1, name, value, 9))
    bench.tell(Port.GCS, mavlink.MAVLink_param_request_read_message(1, 1, name, index))
    told = bench.heard(Port.GCS, "PARAM_VALUE")
    assert len(told) == (0 <= index < len(bench.autopilot.parameters))


def test_one_that_reboots_is_deaf_and_silent_and_comes_back_disarmed_with_its_parameters() -> None:
    bench = Bench()
    bench.autopilot.arm(on=True)
    bench.autopilot.set_mode(Mode.AUTO, "hand")
    bench.autopilot.set_parameter("CRUISE_SPEED", 1.25)
    bench.sent.clear()
    bench.autopilot.reboot(4.0)
    bench.tell(Port.GCS, mavlink.MAVLink_param_set_message(1, 1, b"CRUISE_SPEED", 2.0, 9))
    bench.pass_time(3.9)
    assert bench.sent == []
    bench.pass_time(1.2)
    beats = [message for message in bench.heard(Port.COMPANION) if message.get_type() == "HEARTBEAT"]
    assert [(beat.custom_mode, beat.base_mode & 0x80) for beat in beats] == [(int(Mode.HOLD), 0)] * len(beats)
    assert beats
    assert bench.autopilot.parameters["CRUISE_SPEED"] == 1.25
    assert [change.by for change in bench.autopilot.mode_log] == ["hand", "autopilot"]


def beats_after_a_reboot(bench: Bench, checks: float, seconds: float) -> list[tuple[int, bool]]:
    """Modes and arming that it tells after a reboot out of AUTO, without repetition."""
    bench.autopilot.arm(on=True)
    bench.autopilot.set_mode(Mode.AUTO, "hand")
    bench.sent.clear()
    bench.autopilot.reboot(4.0, checks)
    bench.pass_time(4.0 + seconds)
    beats = [message for message in bench.heard(Port.COMPANION) if message.get_type() == "HEARTBEAT"]
    return list(dict.fromkeys((beat.custom_mode, bool(beat.base_mode & 0x80)) for beat in beats))


@pytest.mark.parametrize("require", [3, 4])
def test_one_that_arms_itself_boots_in_its_initial_mode_and_drives_off(require: int) -> None:
    bench = Bench()
    bench.autopilot.set_parameter("ARMING_REQUIRE", require)
    bench.autopilot.set_parameter("INITIAL_MODE", int(Mode.AUTO))
    assert beats_after_a_reboot(bench, 2.0, 1.5) == [(Mode.AUTO, False)]
    bench.pass_time(1.0)
    assert bench.autopilot.armed
    assert bench.autopilot.rover.drive is MotorDrive.FOLLOW
    bench.autopilot.arm(on=False)
    bench.pass_time(20.0)
    assert not bench.autopilot.armed, "it does so once"


def test_one_that_a_person_arms_boots_in_its_initial_mode_too() -> None:
    bench = Bench()
    bench.autopilot.set_parameter("INITIAL_MODE", int(Mode.MANUAL))
    assert beats_after_a_reboot(bench, 0.0, 20.0) == [(Mode.MANUAL, False)]


def test_its_clock_begins_anew_when_it_reboots() -> None:
    bench = Bench()
    bench.pass_time(10.0)
    bench.autopilot.reboot(4.0)
    bench.sent.clear()
    bench.pass_time(5.0)
    told = [one.time_boot_ms for one in bench.heard(Port.COMPANION) if one.get_type() == "SYSTEM_TIME"]
    assert told
    assert all(0 <= time <= 1000 for time in told)


def test_its_missions_drive_backwards_when_told_and_its_position_says_so(bench: Bench) -> None:
    arm(bench)
    bench.set_mode(Port.GCS, Mode.AUTO)
    assert bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_REVERSE, 1) == mavlink.MAV_RESULT_ACCEPTED
    bench.pass_time(6.0)
    told = bench.heard(Port.COMPANION, "GLOBAL_POSITION_INT")[-1]
    course = math.degrees(math.atan2(told.vy, told.vx))
    assert math.hypot(told.vx, told.vy) == pytest.approx(250.0, abs=5.0)
    assert abs(math.remainder(course - told.hdg / 100.0, 360.0)) == pytest.approx(180.0, abs=2.0)
    assert bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_REVERSE, 0) == mavlink.MAV_RESULT_ACCEPTED
    bench.pass_time(6.0)
    assert bench.rover.speed == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize("what", [2.0, -1.0, math.nan, math.inf])
def test_a_direction_that_makes_no_sense_is_refused(bench: Bench, what: float) -> None:
    assert bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_REVERSE, what) == mavlink.MAV_RESULT_DENIED
    assert not bench.rover.reversed


def test_a_reboot_forgets_the_direction(bench: Bench) -> None:
    bench.command(Port.GCS, mavlink.MAV_CMD_DO_SET_REVERSE, 1)
    bench.autopilot.reboot(1.0)
    assert not bench.rover.reversed
