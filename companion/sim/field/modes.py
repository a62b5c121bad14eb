"""Lists the modes of ArduPilot Rover that the simulated autopilot knows."""

from __future__ import annotations

import enum

from pymavlink.dialects.v20 import development as mavlink


class Mode(enum.IntEnum):
    """A mode; its value is HEARTBEAT.custom_mode. MANUAL, STEERING, AUTO and, with a target, GUIDED drive."""

    MANUAL = 0
    STEERING = 3
    HOLD = 4
    LOITER = 5
    AUTO = 10
    RTL = 11
    GUIDED = 15


def base_mode(mode: Mode, *, armed: bool) -> int:
    """Returns HEARTBEAT.base_mode: always with the custom-mode bit; 0x80 means armed."""
    bits = int(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    if mode in (Mode.MANUAL, Mode.STEERING, Mode.HOLD):
        bits |= int(mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
    else:
        bits |= int(mavlink.MAV_MODE_FLAG_GUIDED_ENABLED)
    if armed:
        bits |= int(mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return bits


def system_status(mode: Mode) -> int:
    """Returns HEARTBEAT.system_status: standby in HOLD, active in every other mode, armed or not."""
    return int(mavlink.MAV_STATE_STANDBY if mode is Mode.HOLD else mavlink.MAV_STATE_ACTIVE)
