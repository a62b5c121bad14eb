"""The one vehicle that this companion rides on, and its remote control."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link.inbound import Pulses
from companion.system.wall_clock import is_set
from companion.vehicle.state import Vehicle

FAILED_LASTS = 5.0
"""s that a receiver counts as failed without being told so again."""
_UNKNOWN_STRENGTH = 255
_CHANNELS = 18


class RemoteControl:
    """Tells pulses from repeated ones as far as the autopilot does: by health or strength, where it has them.

    pulses_at, health_at: s, when RC_CHANNELS and SYS_STATUS came last.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """The autopilot may have rebooted."""
        self.pulses_at = self.health_at = self._failed_at = -math.inf
        self._had_strength = False

    def hear_health(self, message: Any, now: float) -> None:
        """SYS_STATUS. One that knows of no receiver in use says nothing about it."""
        self.health_at = now
        used = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        failed = used & ~message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        self._failed_at = now if failed else -math.inf

    def hear_pulses(self, message: Any, now: float) -> Pulses:
        """RC_CHANNELS; without a channel that counts where the transmitter is known to be gone.

        A strength that is always 0 is none that is measured; one that falls to 0 is a loss.
        """
        self.pulses_at = now
        strength = int(message.rssi)
        self._had_strength = self._had_strength or 0 < strength < _UNKNOWN_STRENGTH
        gone = now - self._failed_at <= FAILED_LASTS or (self._had_strength and strength == 0)
        widths = tuple(int(getattr(message, f"chan{number}_raw")) for number in range(1, _CHANNELS + 1))
        return Pulses(widths, 0 if gone else int(message.chancount))


POSITION_LIFETIME = 5.0
SETTLE = 2.5
SILENCE = 3.0
_UNKNOWN_HEADING = 65535


class VehicleTracker:
    """Adopts the autopilot with the configured id, or after 2.5 s without it the first one; then only that.

    `returns` rises when it is first heard, and again after a silence: it may not know our route.
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
        """Whether this heartbeat of some component 1 is our vehicle's, or that of one to adopt."""
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type == mavlink.MAV_TYPE_GCS:
            return False
        return self._adopts(system_id, now) if self.vehicle is None else self.is_ours(system_id)

    def heartbeat(self, system_id: int, message: Any, now: float) -> None:
        """A heartbeat that `claims` it."""
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
        """CURRENT_MODE; True when it is our vehicle's. Only a heartbeat tells that it is armed, and alive."""
        if self.vehicle is None or self.vehicle.system_id != system_id:
            return False
        self.vehicle = replace(self.vehicle, custom_mode=int(message.custom_mode), mode_at=now)
        return True

    def position(self, system_id: int, message: Any, now: float) -> bool:
        """GLOBAL_POSITION_INT; True when it told something about our vehicle."""
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return False
        if message.lat == 0 and message.lon == 0:
            return False
        if abs(message.lat) > 900_000_000 or abs(message.lon) > 1_800_000_000:
            return False
        heading = None if message.hdg == _UNKNOWN_HEADING else message.hdg / 100 % 360
        self.vehicle = replace(
            self.vehicle,
            position=(message.lat / 1e7, message.lon / 1e7, heading),
            speed=math.hypot(message.vx, message.vy) / 100,
            position_at=now,
        )
        return True

    def attitude(self, system_id: int, message: Any, now: float) -> None:
        """ATTITUDE; told in radians."""
        angles = (message.roll, message.pitch, message.yaw)
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return
        if all(abs(angle) <= math.tau for angle in angles):  # False for NaN
            roll, pitch, yaw = (round(math.degrees(angle), 2) for angle in angles)
            self.vehicle = replace(self.vehicle, attitude=(roll, pitch, yaw % 360), attitude_at=now)

    def time(self, system_id: int, message: Any, now: float) -> None:
        """SYSTEM_TIME; 0 or some year long ago where the autopilot does not know it."""
        seconds = message.time_unix_usec / 1e6
        if self.is_ours(system_id) and self.vehicle is not None and is_set(seconds):
            self.vehicle = replace(self.vehicle, clock=seconds - now, clock_at=now)

    def tick(self, now: float) -> None:
        """Forget a position and an attitude that are too old."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        if vehicle.position is not None and now - (vehicle.position_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = vehicle = replace(vehicle, position=None, speed=None)
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
