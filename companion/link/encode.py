"""MAVLink messages as the companion sends them."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.autopilots import ModeCommand
from companion.wire.ids import AUTOPILOT_COMPONENT_ID, MAX_TEXT, Policy, State, heartbeat_mode
from companion.wire.parameters import Parameter

_VELOCITY_ONLY = 0b1101_1100_0111
"""POSITION_TARGET_TYPEMASK: all but the three velocities are to be ignored."""

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
