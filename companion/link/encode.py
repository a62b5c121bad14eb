"""MAVLink messages as the companion sends them, and the MAVLink version of their frames."""

from __future__ import annotations

import re
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.vehicle import ModeCommand
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, MAX_TEXT, Policy, State, heartbeat_mode
from companion.wire.parameters import Parameter

PATIENCE = 10.0
PROBE_PERIOD = 10.0
_LAST_ID = 255
_PLAIN_LENGTH = {
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: 3,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: 51,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: 60,
}
"""Payload bytes before the extensions, which MAVLink 1 does not know."""


class MavlinkVersion:
    """Version 1 once nothing but it has been heard for 10 s, else 2. The first frame of 2 changes back.

    An autopilot that begins in 1 and changes over when it hears 2 needs to hear some: while we speak 1, a
    heartbeat goes out as 2 every 10 s.
    """

    def __init__(self) -> None:
        self._alone_since: float | None = None
        self._probe_at = 0.0
        self.is_1 = False

    def forget(self) -> None:
        """The device was opened anew: who knows what is at its other end now."""
        self._alone_since, self.is_1 = None, False

    def hear(self, message: Any, now: float) -> None:
        """A message of somebody else came."""
        if message.get_msgbuf()[0] != mavlink.PROTOCOL_MARKER_V1:
            self.forget()
        elif self._alone_since is None:
            self._alone_since = now
        elif not self.is_1 and now - self._alone_since >= PATIENCE:
            self.is_1, self._probe_at = True, now + PROBE_PERIOD

    def packs_1(self, name: str, now: float) -> bool:
        """Whether a message of the table's row `name` goes out as version 1."""
        return self.is_1 and not (name == "heartbeat" and now >= self._probe_at)

    def told(self, frame: bytes, now: float) -> None:
        """`frame` left."""
        if frame[0] != mavlink.PROTOCOL_MARKER_V1:
            self._probe_at = now + PROBE_PERIOD


def fits_1(message: Any) -> bool:
    """Whether version 1 has a place for this message's id."""
    return bool(message.get_msgId() <= _LAST_ID)


def pack_1(message: Any, mav: Any) -> bytes:
    """A frame of version 1, without what is an extension of version 2."""
    packed = bytes(message.pack(mav, force_mavlink1=True))
    plain = _PLAIN_LENGTH.get(message.get_msgId())
    if plain is None:
        return packed
    payload = bytes(message.get_payload()[:plain])
    return bytes(message._pack(mav, message.crc_extra, payload, force_mavlink1=True))


_VELOCITY_ONLY = 0b1101_1100_0111
"""POSITION_TARGET_TYPEMASK: all but the three velocities are to be ignored."""

CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
"""MAV_PROTOCOL_CAPABILITY; none exists for the extended parameters."""

_STATUS = {
    State.STARTING: mavlink.MAV_STATE_BOOT,
    State.OK: mavlink.MAV_STATE_ACTIVE,
    State.CALLING: mavlink.MAV_STATE_CRITICAL,
    State.HOLDING: mavlink.MAV_STATE_CRITICAL,
    State.BLOCKED: mavlink.MAV_STATE_CRITICAL,
    State.FAULT: mavlink.MAV_STATE_EMERGENCY,
    State.OFF: mavlink.MAV_STATE_STANDBY,
}


def heartbeat(state: State, current_id: int, policy: Policy) -> Any:
    """base_mode stays 0: anything else changes mode displays at the ground."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        mavlink.MAV_AUTOPILOT_INVALID,
        0,
        heartbeat_mode(state, current_id, policy),
        _STATUS[state],
        3,
    )


def tunnel(payload_type: int, payload: bytes, target: tuple[int, int] = (0, 0)) -> Any:
    """`payload` of at most 128 bytes; to everyone unless a target is given."""
    padded = payload + bytes(128 - len(payload))
    return mavlink.MAVLink_tunnel_message(*target, payload_type, len(payload), padded)


def text(content: str, severity: int) -> Any:
    """Cut between characters to 50 bytes."""
    cut = content.encode(errors="replace")[:MAX_TEXT].decode(errors="ignore").encode()
    return mavlink.MAVLink_statustext_message(severity, cut)


def number(name: str, value: float, uptime_ms: int) -> Any:
    """A name of at most 10 characters."""
    return mavlink.MAVLink_named_value_float_message(uptime_ms & 0xFFFFFFFF, name.encode(), value)


def parameter(entry: Parameter, index: int, count: int) -> Any:
    """Always REAL32: the one encoding that all ground stations treat alike."""
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
    """What we can do, and `version` ("0.1.0", anything behind it makes it a development version)."""
    release = re.match(r"(\d+)\.(\d+)\.(\d+)$", version)
    numbers = [min(255, int(one)) for one in re.findall(r"\d+", version)[:3]] + [0, 0, 0]
    kind = mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL if release else mavlink.FIRMWARE_VERSION_TYPE_DEV
    packed = numbers[0] << 24 | numbers[1] << 16 | numbers[2] << 8 | kind
    custom = version.encode(errors="replace")[:8].ljust(8, b"\0")
    none = bytes(8)
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES, packed, 0, 0, 0, list(custom), list(none), list(none), 0, 0, 0
    )


def message_interval(message_id: int, microseconds: int) -> Any:
    """MESSAGE_INTERVAL: -1 is never, 0 is unknown."""
    return mavlink.MAVLink_message_interval_message(message_id, microseconds)


def file_transfer(payload: bytes, target: tuple[int, int]) -> Any:
    """All 251 bytes of an FTP payload, to the asker."""
    return mavlink.MAVLink_file_transfer_protocol_message(0, *target, payload)


def command_ack(command: int, result: int, target: tuple[int, int]) -> Any:
    """To the asker."""
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, *target)


def set_mode(system_id: int, command: ModeCommand) -> Any:
    """DO_SET_MODE with base, main and sub mode."""
    return _command(system_id, mavlink.MAV_CMD_DO_SET_MODE, *command)


def stand_still(system_id: int, uptime_ms: int) -> Any:
    """Zero velocity over ground; everything else is left to the autopilot."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        uptime_ms & 0xFFFFFFFF,
        system_id,
        AUTOPILOT_COMPONENT_ID,
        mavlink.MAV_FRAME_LOCAL_NED,
        _VELOCITY_ONLY,
        *[0.0] * 11,
    )


def ask_for(system_id: int, message_id: int, period: float) -> Any:
    """SET_MESSAGE_INTERVAL: the message every `period` s, on our own port only."""
    return _command(system_id, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, round(period * 1e6))


def _command(system_id: int, command: int, first: float, second: float, third: float = 0.0) -> Any:
    return mavlink.MAVLink_command_long_message(
        system_id, AUTOPILOT_COMPONENT_ID, command, 0, first, second, third, 0, 0, 0, 0
    )
