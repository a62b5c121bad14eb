"""Builds the MAVLink messages that the companion sends, and chooses the MAVLink version of their frames."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.vehicle import ModeCommand
from companion.wire.ids import (
    AUTOPILOT_COMPONENT_ID,
    CPU_THROTTLED,
    DISK_FULL,
    MAX_TEXT,
    MODE_REQUEST_COMMAND,
    NO_TEMPERATURE,
    UNDER_VOLTAGE,
    HeartbeatMode,
    State,
    heartbeat_mode,
)
from companion.wire.parameters import Parameter

PATIENCE = 10.0
"""s of MAVLink 1 alone after which we send MAVLink 1, too."""
PROBE_PERIOD = 10.0
"""s between heartbeats in MAVLink 2 meanwhile."""
_LAST_ID = 255
_PLAIN_LENGTH = {
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: 3,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: 51,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: 60,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: 2,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT: 4,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: 3,
}
"""Payload bytes before the extensions, which MAVLink 1 does not know."""


class MavlinkVersion:
    """Chooses version 1 once only version 1 was received for 10 s, and 2 otherwise.

    Some autopilots start in version 1 and change to 2 when they receive it. So while we send version 1, one
    heartbeat every 10 s is sent in version 2.
    """

    def __init__(self) -> None:
        self._only_version_1_since: float | None = None
        self._probe_at = 0.0
        self.is_1 = False

    def forget(self) -> None:
        """Return to version 2, after a reconnect or a received version 2 frame."""
        self._only_version_1_since, self.is_1 = None, False

    def received(self, message: Any, now: float) -> None:
        """Note the version of a received message."""
        if message.get_msgbuf()[0] != mavlink.PROTOCOL_MARKER_V1:
            self.forget()
        elif self._only_version_1_since is None:
            self._only_version_1_since = now
        elif not self.is_1 and now - self._only_version_1_since >= PATIENCE:
            self.is_1, self._probe_at = True, now + PROBE_PERIOD

    def packs_1(self, name: str, now: float) -> bool:
        """Whether to send a message of the table's row `name` in version 1."""
        return self.is_1 and not (name == "heartbeat" and now >= self._probe_at)

    def sent(self, frame: bytes, now: float) -> None:
        """Note that `frame` was sent."""
        if frame[0] != mavlink.PROTOCOL_MARKER_V1:
            self._probe_at = now + PROBE_PERIOD


def fits_1(message: Any) -> bool:
    """Whether version 1 can carry this message's id, at most 255."""
    return bool(message.get_msgId() <= _LAST_ID)


def pack_1(message: Any, mav: Any) -> bytes:
    """Pack a version 1 frame, without the extension fields, which exist in version 2 only."""
    packed = bytes(message.pack(mav, force_mavlink1=True))
    plain = _PLAIN_LENGTH.get(message.get_msgId())
    if plain is None:
        return packed
    payload = bytes(message.get_payload()[:plain])
    return bytes(message._pack(mav, message.crc_extra, payload, force_mavlink1=True))


_VELOCITY_ONLY = 0b1101_1100_0111
"""POSITION_TARGET_TYPEMASK: ignore all but the three velocities."""
_VELOCITY_AND_YAW_RATE = 0b0101_1100_0111
"""The same, but the yaw rate counts, too."""

CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
"""MAV_PROTOCOL_CAPABILITY; there is no flag for the extended parameter protocol."""

_STATUS = {
    State.STARTING: mavlink.MAV_STATE_BOOT,
    State.OK: mavlink.MAV_STATE_ACTIVE,
    State.CALLING: mavlink.MAV_STATE_CRITICAL,
    State.HOLDING: mavlink.MAV_STATE_CRITICAL,
    State.BLOCKED: mavlink.MAV_STATE_CRITICAL,
    State.FAULT: mavlink.MAV_STATE_EMERGENCY,
    State.OFF: mavlink.MAV_STATE_STANDBY,
}


def heartbeat(content: HeartbeatMode) -> Any:
    """HEARTBEAT. base_mode stays 0: anything else changes the mode that ground stations display."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        mavlink.MAV_AUTOPILOT_INVALID,
        0,
        heartbeat_mode(*content),
        _STATUS[content.state],
        3,
    )


def tunnel(payload_type: int, payload: bytes, target: tuple[int, int] = (0, 0)) -> Any:
    """TUNNEL with a payload of at most 128 bytes; broadcast unless `target` (system, component) is given."""
    padded = payload + bytes(128 - len(payload))
    return mavlink.MAVLink_tunnel_message(*target, payload_type, len(payload), padded)


def text(content: str, severity: int) -> Any:
    """STATUSTEXT of MAV_SEVERITY `severity`; `content` is cut between characters to 50 bytes."""
    cut = content.encode(errors="replace")[:MAX_TEXT].decode(errors="ignore").encode()
    return mavlink.MAVLink_statustext_message(severity, cut)


def number(name: str, value: float, uptime_ms: int) -> Any:
    """NAMED_VALUE_FLOAT; `name` has at most 10 characters."""
    return mavlink.MAVLink_named_value_float_message(uptime_ms & 0xFFFFFFFF, name.encode(), value)


_UNKNOWN_8, _UNKNOWN_16, _UNKNOWN_32 = 0xFF, 0x7FFF, 0xFFFFFFFF


def computer_status(figures: Mapping[str, Any], uptime: float) -> Any:
    """ONBOARD_COMPUTER_STATUS. figures: as of `Computer.measure`. uptime: s since the computer started.

    The share of the CPU is that of a second, in each of its ten tenths.
    """
    degrees, cpu = figures.get("temperature"), figures.get("cpu")
    low, throttled, free = (figures.get(name) for name in ("under_voltage", "throttled", "disk_free"))
    memory, disk = _used(figures, "memory"), _used(figures, "disk")
    return mavlink.MAVLink_onboard_computer_status_message(
        time_usec=round(uptime * 1e6),
        uptime=round(uptime * 1e3) & 0xFFFFFFFF,
        type=0,
        cpu_cores=[_UNKNOWN_8] * 8,
        cpu_combined=[_UNKNOWN_8 if cpu is None else round(100.0 * cpu)] * 10,
        gpu_cores=[_UNKNOWN_8] * 4,
        gpu_combined=[_UNKNOWN_8] * 10,
        temperature_board=NO_TEMPERATURE if degrees is None else min(round(degrees), NO_TEMPERATURE - 1),
        temperature_core=[NO_TEMPERATURE] * 8,
        fan_speed=[_UNKNOWN_16] * 4,
        ram_usage=memory[0],
        ram_total=memory[1],
        storage_type=[_UNKNOWN_32] * 4,
        storage_usage=[disk[0], *[_UNKNOWN_32] * 3],
        storage_total=[disk[1], *[_UNKNOWN_32] * 3],
        link_type=[_UNKNOWN_32] * 6,
        link_tx_rate=[_UNKNOWN_32] * 6,
        link_rx_rate=[_UNKNOWN_32] * 6,
        link_tx_max=[_UNKNOWN_32] * 6,
        link_rx_max=[_UNKNOWN_32] * 6,
        status_flags=UNDER_VOLTAGE * bool(low) | CPU_THROTTLED * bool(throttled) | DISK_FULL * (free == 0),
    )


def _used(figures: Mapping[str, Any], name: str) -> tuple[int, int]:
    """Return MiB used and in all, `_UNKNOWN_32` for what is not known or cannot be.

    A network's file system may tell more than the field holds, and a container more free than there is.
    """
    total, free = figures.get(name), figures.get(f"{name}_free")
    if total is None or total > _UNKNOWN_32:
        return _UNKNOWN_32, _UNKNOWN_32
    return _UNKNOWN_32 if free is None or free > total else total - free, total


def parameter(entry: Parameter, index: int, count: int) -> Any:
    """PARAM_VALUE, always REAL32: the one type that all ground stations decode in the same way."""
    return mavlink.MAVLink_param_value_message(
        entry.name.encode(), entry.value, mavlink.MAV_PARAM_TYPE_REAL32, count, index
    )


def no_parameter(name: bytes, index: int, target: tuple[int, int]) -> Any:
    """PARAM_ERROR: no parameter of this name, or of this index where that is not negative."""
    missing = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
    return mavlink.MAVLink_param_error_message(*target, name, index, missing)


def text_parameter(name: str, text: str, index: int, count: int) -> Any:
    """PARAM_EXT_VALUE of a string of at most 128 bytes."""
    return mavlink.MAVLink_param_ext_value_message(
        name.encode(), text.encode(), mavlink.MAV_PARAM_EXT_TYPE_CUSTOM, count, index
    )


def text_ack(name: bytes, value: bytes, result: int) -> Any:
    """PARAM_EXT_ACK. result: PARAM_ACK."""
    return mavlink.MAVLink_param_ext_ack_message(name, value, mavlink.MAV_PARAM_EXT_TYPE_CUSTOM, result)


def autopilot_version(version: str) -> Any:
    """AUTOPILOT_VERSION with `CAPABILITIES`. version: "0.1.0"; a suffix marks a development version."""
    custom = version.encode(errors="replace")[:8].ljust(8, b"\0")
    none = bytes(8)
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES, packed_version(version), 0, 0, 0, list(custom), list(none), list(none), 0, 0, 0
    )


def packed_version(version: str) -> int:
    """Pack "0.1.0" as flight_sw_version and firmware_version want it: a byte each, and the release's kind."""
    release = re.match(r"(\d+)\.(\d+)\.(\d+)$", version)
    numbers = [min(255, int(one)) for one in re.findall(r"\d+", version)[:3]] + [0, 0, 0]
    kind = mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL if release else mavlink.FIRMWARE_VERSION_TYPE_DEV
    return numbers[0] << 24 | numbers[1] << 16 | numbers[2] << 8 | int(kind)


def message_interval(message_id: int, microseconds: int) -> Any:
    """MESSAGE_INTERVAL; microseconds: -1 the message is not sent, 0 it is unknown."""
    return mavlink.MAVLink_message_interval_message(message_id, microseconds)


def file_transfer(payload: bytes, target: tuple[int, int]) -> Any:
    """FILE_TRANSFER_PROTOCOL with the 251 bytes of an FTP payload, to `target`."""
    return mavlink.MAVLink_file_transfer_protocol_message(0, *target, payload)


def command_ack(command: int, result: int, target: tuple[int, int]) -> Any:
    """COMMAND_ACK to `target`. result: MAV_RESULT."""
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, *target)


def set_mode(system_id: int, command: ModeCommand, hold: int = 0) -> Any:
    """MAV_CMD_DO_SET_MODE with base, main and sub mode; param7 tells the autopilot's script the hold's id."""
    return _command(system_id, mavlink.MAV_CMD_DO_SET_MODE, *command, seventh=hold)


def mode_request(system_id: int, hold: int, expected: int, mode: int, serial: int, brake: float) -> Any:
    """`MODE_REQUEST_COMMAND` to the script on the autopilot."""
    return _command(system_id, MODE_REQUEST_COMMAND, hold, expected, mode, serial, fifth=brake)


def set_item(system_id: int, item: int) -> Any:
    """MAV_CMD_DO_SET_MISSION_CURRENT: make an item the current one, and leave all else as it is."""
    return _command(system_id, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, item, 0)


def mission_list(system_id: int) -> Any:
    """MISSION_REQUEST_LIST: ask how many items the mission has."""
    return mavlink.MAVLink_mission_request_list_message(system_id, AUTOPILOT_COMPONENT_ID)


def mission_request(system_id: int, item: int) -> Any:
    """MISSION_REQUEST_INT: ask for an item of the mission."""
    return mavlink.MAVLink_mission_request_int_message(system_id, AUTOPILOT_COMPONENT_ID, item)


def mission_taken(system_id: int) -> Any:
    """MISSION_ACK: all items of the mission have come."""
    return mavlink.MAVLink_mission_ack_message(
        system_id, AUTOPILOT_COMPONENT_ID, mavlink.MAV_MISSION_ACCEPTED
    )


def stand_still(system_id: int, uptime_ms: int) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED with zero velocity; everything else is left to the autopilot."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        uptime_ms & 0xFFFFFFFF,
        system_id,
        AUTOPILOT_COMPONENT_ID,
        mavlink.MAV_FRAME_LOCAL_NED,
        _VELOCITY_ONLY,
        *[0.0] * 11,
    )


def drive(system_id: int, uptime_ms: int, speed: float, yaw_rate: float) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED with a speed along the nose, m/s, and a turn rate, rad/s clockwise."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        uptime_ms & 0xFFFFFFFF,
        system_id,
        AUTOPILOT_COMPONENT_ID,
        mavlink.MAV_FRAME_BODY_NED,
        _VELOCITY_AND_YAW_RATE,
        *[0.0] * 3,
        speed,
        *[0.0] * 6,
        yaw_rate,
    )


def centred_sticks(system_id: int) -> Any:
    """MANUAL_CONTROL that neither drives nor steers: PX4 reads z from 0 to 1000, with no thrust at 500."""
    return mavlink.MAVLink_manual_control_message(system_id, 0, 0, 500, 0, 0)


def ask_for(system_id: int, message_id: int, period: float) -> Any:
    """MAV_CMD_SET_MESSAGE_INTERVAL: request a message every `period` s, on our own port only."""
    return _command(system_id, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, round(period * 1e6))


def _command(
    system_id: int,
    command: int,
    first: float,
    second: float,
    third: float = 0.0,
    fourth: float = 0.0,
    *,
    fifth: float = 0.0,
    seventh: float = 0.0,
) -> Any:
    return mavlink.MAVLink_command_long_message(
        system_id, AUTOPILOT_COMPONENT_ID, command, 0, first, second, third, fourth, fifth, 0, seventh
    )
