"""Tracks the state of our vehicle and the signal of its remote control, from the autopilot's telemetry."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link.inbound import RcChannels
from companion.vehicle.state import Vehicle, is_set

FAILED_LASTS = 5.0
"""s that a failed RC receiver counts as failed without a new report."""
_UNKNOWN_STRENGTH = 255
_CHANNELS = 18


class RemoteControl:
    """Judges whether RC channels are live: an autopilot may repeat the last ones after a loss of signal.

    It goes by the receiver's health (SYS_STATUS) and signal strength, where the autopilot reports them.
    pulses_at, health_at: s, when RC_CHANNELS and SYS_STATUS were last received.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget everything, as the autopilot may have rebooted."""
        self.pulses_at = self.health_at = self._failed_at = -math.inf
        self._had_strength = False

    def receive_health(self, message: Any, now: float) -> None:
        """Take SYS_STATUS. It counts only where the autopilot has an RC receiver present and enabled."""
        self.health_at = now
        used = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        failed = used & ~message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        self._failed_at = now if failed else -math.inf

    def receive_pulses(self, message: Any, now: float) -> RcChannels:
        """Take RC_CHANNELS; return them, with a count of 0 where the signal is known to be lost.

        A strength that was always 0 is not measured. One that falls to 0 is a loss.
        """
        self.pulses_at = now
        strength = int(message.rssi)
        self._had_strength = self._had_strength or 0 < strength < _UNKNOWN_STRENGTH
        gone = now - self._failed_at <= FAILED_LASTS or (self._had_strength and strength == 0)
        widths = tuple(int(getattr(message, f"chan{number}_raw")) for number in range(1, _CHANNELS + 1))
        return RcChannels(widths, 0 if gone else int(message.chancount))


POSITION_LIFETIME = 5.0
"""s after which a position or attitude is forgotten."""
SETTLE = 2.5
"""s for which the autopilot with the configured id is waited for, before another is adopted."""
SILENCE = 3.0
"""s without a heartbeat after which the autopilot counts as silent."""
_UNKNOWN_HEADING = 65535


class VehicleTracker:
    """Adopts one autopilot and tracks its state.

    It adopts the autopilot with the configured id, or the first other one that was received for 2.5 s.
    `returns` counts its first heartbeat and each one after a silence: it may have rebooted and forgotten what
    we asked.
    """

    def __init__(self, configured: int) -> None:
        self._configured = configured
        self._candidate = 0
        self._candidate_since = self._candidate_at = -math.inf
        self.vehicle: Vehicle | None = None
        self.returns = 0

    def is_ours(self, system_id: int) -> bool:
        """Whether this is the adopted autopilot's system."""
        return self.vehicle is not None and self.vehicle.system_id == system_id

    def claims(self, system_id: int, message: Any, now: float) -> bool:
        """Whether this heartbeat of a component 1 is from our vehicle, or from one to adopt."""
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type == mavlink.MAV_TYPE_GCS:
            return False
        return self._adopts(system_id, now) if self.vehicle is None else self.is_ours(system_id)

    def heartbeat(self, system_id: int, message: Any, now: float) -> None:
        """Take a heartbeat for which `claims` was True."""
        before = self.vehicle or Vehicle(system_id, 0, 0, armed=False, heard_at=-math.inf)
        self.returns += now - before.heard_at > SILENCE
        self.vehicle = replace(
            before,
            autopilot=int(message.autopilot),
            type=int(message.type),
            custom_mode=int(message.custom_mode),
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            heard_at=now,
        )

    def mode(self, system_id: int, message: Any, now: float) -> bool:
        """Take CURRENT_MODE; True when it is our vehicle's. It does not count as a sign of life."""
        if self.vehicle is None or self.vehicle.system_id != system_id:
            return False
        self.vehicle = replace(self.vehicle, custom_mode=int(message.custom_mode), mode_at=now)
        return True

    def position(self, system_id: int, message: Any, now: float) -> bool:
        """Take GLOBAL_POSITION_INT; True when it is our vehicle's and valid."""
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return False
        if message.lat == 0 and message.lon == 0:  # sent before the first fix
            return False
        if abs(message.lat) > 900_000_000 or abs(message.lon) > 1_800_000_000:
            return False
        heading = None if message.hdg == _UNKNOWN_HEADING else message.hdg / 100 % 360
        self.vehicle = replace(
            self.vehicle,
            position=(message.lat / 1e7, message.lon / 1e7, heading),
            speed=math.hypot(message.vx, message.vy) / 100,
            course=_course(message.vx, message.vy),
            position_at=now,
        )
        return True

    def attitude(self, system_id: int, message: Any, now: float) -> None:
        """Take ATTITUDE, in radians; it is stored in degrees."""
        angles = (message.roll, message.pitch, message.yaw)
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return
        if all(abs(angle) <= math.tau for angle in angles):  # False for NaN
            roll, pitch, yaw = (round(math.degrees(angle), 2) for angle in angles)
            self.vehicle = replace(self.vehicle, attitude=(roll, pitch, yaw % 360), attitude_at=now)

    def time(self, system_id: int, message: Any, now: float) -> None:
        """Take SYSTEM_TIME. An autopilot without the time sends 0 or a year long ago: that is ignored."""
        seconds = message.time_unix_usec / 1e6
        if self.is_ours(system_id) and self.vehicle is not None and is_set(seconds):
            self.vehicle = replace(self.vehicle, clock=seconds - now, clock_at=now)

    def tick(self, now: float) -> None:
        """Forget a position and an attitude that are older than 5 s."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        if vehicle.position is not None and now - (vehicle.position_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = vehicle = replace(vehicle, position=None, speed=None, course=None)
        if vehicle.attitude is not None and now - (vehicle.attitude_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = replace(vehicle, attitude=None)

    def _adopts(self, system_id: int, now: float) -> bool:
        if system_id == self._configured:
            return True
        if now - self._candidate_at > SILENCE:
            self._candidate, self._candidate_since = system_id, now
        if system_id != self._candidate:
            return False
        self._candidate_at = now
        return now - self._candidate_since >= SETTLE


def _course(north: int, east: int) -> float | None:
    """Return the direction of a velocity in degrees clockwise from north, None where it is 0."""
    return math.degrees(math.atan2(east, north)) % 360 if north or east else None
