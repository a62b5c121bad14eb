"""Makes the messages that the autopilot streams unasked, and keeps each port's rates."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.modes import Mode, base_mode, system_status

if TYPE_CHECKING:
    from companion.sim.field.rover import Rover


HEARTBEAT_PERIOD = 1.0
ORIGIN_LATITUDE = 47.0
ORIGIN_LONGITUDE = 8.0
METRES_PER_DEGREE = 111_320.0
RC_CHANNELS = 16
_NO_CHANNEL = 65535
SLOWEST_PERIOD = 60.0
FASTEST_PERIOD = 0.02


def heartbeat(mode: Mode, *, armed: bool) -> Any:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GROUND_ROVER,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode(mode, armed=armed),
        int(mode),
        system_status(mode),
        3,
    )


def degrees_e7(x: float, y: float) -> tuple[int, int]:
    """Returns latitude and longitude, in degrees x 10^7, of a place on the field in m."""
    latitude = ORIGIN_LATITUDE + y / METRES_PER_DEGREE
    longitude = ORIGIN_LONGITUDE + x / (METRES_PER_DEGREE * math.cos(math.radians(ORIGIN_LATITUDE)))
    return round(latitude * 1e7), round(longitude * 1e7)


def position(rover: Rover) -> Any:
    return mavlink.MAVLink_global_position_int_message(
        _boot_ms(rover),
        *degrees_e7(rover.x, rover.y),
        450_000,
        0,
        round(100 * rover.speed * math.sin(rover.heading)),
        round(100 * rover.speed * math.cos(rover.heading)),
        0,
        round(math.degrees(_yaw(rover)) * 100) % 36_000,
    )


def attitude(rover: Rover) -> Any:
    """Makes ATTITUDE. Its rates are those of pitch and roll, at small angles also those of the body."""
    at, yaw = rover.attitude, math.remainder(_yaw(rover), math.tau)
    return mavlink.MAVLink_attitude_message(
        _boot_ms(rover), at.roll, at.pitch, yaw, at.roll_rate, at.pitch_rate, 0.0
    )


def battery(rover: Rover) -> Any:
    left = max(0, 100 - int(rover.time / 120))
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 150, 12_400, 350, left, 0, 0, 0, 0, 0, 0)


def clock(rover: Rover) -> Any:
    return mavlink.MAVLink_system_time_message(int(time.time() * 1e6), _boot_ms(rover))


def vfr_hud(rover: Rover) -> Any:
    speed, heading = abs(rover.speed), round(math.degrees(_yaw(rover))) % 360
    throttle = round(100 * rover.speed / rover.body.top_speed) % (1 << 16)
    return mavlink.MAVLink_vfr_hud_message(speed, speed, heading, throttle, 450.0, 0.0)


def rc_channels(rover: Rover) -> Any:
    """Makes RC_CHANNELS: steering on channel 1 (right is more), throttle on 3, switches as set."""
    if not rover.transmitter.on:
        return mavlink.MAVLink_rc_channels_message(_boot_ms(rover), 0, *[_NO_CHANNEL] * 18, 0)
    pulses = [1500] * RC_CHANNELS
    pulses[0] = round(1500 - 500 * rover.transmitter.steering)
    pulses[2] = round(1500 + 500 * rover.transmitter.throttle)
    for channel, pulse in rover.transmitter.switches.items():
        pulses[channel - 1] = pulse
    return mavlink.MAVLink_rc_channels_message(_boot_ms(rover), RC_CHANNELS, *pulses, *[0] * 2, 254)


MESSAGES: dict[int, tuple[Callable[[Rover], Any], float]] = {
    int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT): (position, 0.25),
    int(mavlink.MAVLINK_MSG_ID_ATTITUDE): (attitude, 0.25),
    int(mavlink.MAVLINK_MSG_ID_SYS_STATUS): (battery, 0.5),
    int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME): (clock, 0.5),
    int(mavlink.MAVLINK_MSG_ID_VFR_HUD): (vfr_hud, 0.5),
    int(mavlink.MAVLINK_MSG_ID_RC_CHANNELS): (rc_channels, 1.0),
}


class Streams:
    """Keeps when each message is due on one port."""

    def __init__(self, periods: Mapping[int, float]) -> None:
        """periods: default period in s of every message id; inf: sent only when an interval is set."""
        self._defaults = dict(periods)
        self._periods = {number: period for number, period in periods.items() if math.isfinite(period)}
        self._due = dict.fromkeys(periods, 0.0)

    def set_interval(self, number: int, microseconds: float) -> bool:
        """Does MAV_CMD_SET_MESSAGE_INTERVAL: -1 stops the message, 0 restores its default. False: refused."""
        if number not in self._defaults or not math.isfinite(microseconds):
            return False
        if microseconds < 0:
            self._periods.pop(number, None)
        elif microseconds == 0:
            self._periods[number] = self._defaults[number]
        else:
            self._periods[number] = min(SLOWEST_PERIOD, max(FASTEST_PERIOD, microseconds / 1e6))
        self._due[number] = 0.0
        return True

    def due(self, now: float) -> list[int]:
        """Returns the ids to send now; each is due again one period later."""
        ready = [number for number in self._periods if self._due[number] <= now]
        for number in ready:
            self._due[number] = now + self._periods[number]
        return ready


def _yaw(rover: Rover) -> float:
    """Returns the yaw clockwise from north, [0, 2 pi); the field's x points east, its y north."""
    return (math.pi / 2 - rover.heading) % math.tau


def _boot_ms(rover: Rover) -> int:
    return int((rover.time - rover.booted_at) * 1000) & 0xFFFFFFFF
