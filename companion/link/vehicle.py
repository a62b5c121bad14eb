"""Tracks the state of our vehicle and the signal of its remote control, from the autopilot's telemetry."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link.inbound import RcChannels
from companion.vehicle.course import along_nose
from companion.vehicle.motion import LeanFilter, Odometry
from companion.vehicle.state import PUSHES, Mission, MissionState, Vehicle, is_set

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
"""s after which a position or attitude is forgotten, and the mission's state is not known any more."""
SETTLE = 2.5
"""s for which the autopilot with the configured id is waited for, before another is adopted."""
SILENCE = 3.0
"""s without a heartbeat after which the autopilot counts as silent."""
_UNKNOWN_HEADING = 65535
_BACKWARDS = 3000
"""ms that the time since boot must run backwards to show a reboot: messages may overtake each other."""
_WRAPS = 1 << 31
"""ms that it runs backwards only where its 32 bits are used up, after 49 days."""
_FASTEST = 10.0
"""rad/s. No rover turns over faster: such a rate is noise, as NaN is."""
_HEADER = 10
"""Bytes of a MAVLink 2 frame before its payload."""
_NO_TOTAL = (0, 65535)
"""Values of MISSION_CURRENT.total: not reported, and no mission."""
_MISSION_ID = slice(6, 10)
"""Bytes of MISSION_CURRENT with the id of the mission's content, which pymavlink does not know yet."""


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
        self._uptime = 0
        self._lean_filter = LeanFilter()
        self._odometry = Odometry()

    def is_ours(self, system_id: int) -> bool:
        """Whether this is the adopted autopilot's system."""
        return self.vehicle is not None and self.vehicle.system_id == system_id

    def home_moved(self) -> None:
        """Forget the time since boot: another connection may deliver it seconds later than the one before."""
        self._uptime = 0

    def claims(self, system_id: int, message: Any, now: float) -> bool:
        """Whether this heartbeat of a component 1 is from our vehicle, or from one to adopt."""
        if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type == mavlink.MAV_TYPE_GCS:
            return False
        return self._adopts(system_id, now) if self.vehicle is None else self.is_ours(system_id)

    def heartbeat(self, system_id: int, message: Any, now: float) -> None:
        """Take a heartbeat for which `claims` was True."""
        before = self.vehicle or Vehicle(system_id, 0, 0, armed=False, heard_at=-math.inf)
        self.returns += now - before.heard_at > SILENCE
        before = _in_mode(before, int(message.custom_mode))
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
        vehicle = _in_mode(self.vehicle, int(message.custom_mode))
        self.vehicle = replace(vehicle, custom_mode=int(message.custom_mode), mode_at=now)
        return True

    def mode_was_set(self, mode: int, now: float) -> None:
        """Take in that the script has set a mode and read it back. It counts as a heartbeat that shows it."""
        if self.vehicle is not None:
            self.vehicle = replace(_in_mode(self.vehicle, mode), custom_mode=mode, heard_at=now)

    def position(self, system_id: int, message: Any, now: float) -> bool:
        """Take GLOBAL_POSITION_INT; True when it is our vehicle's and valid."""
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return False
        self._note_uptime(message)
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
        self._note_uptime(message)
        if all(abs(angle) <= math.tau for angle in angles):  # False for NaN
            roll, pitch, yaw = (round(math.degrees(angle), 2) for angle in angles)
            rates = [
                math.degrees(one) if abs(one) <= _FASTEST else 0.0
                for one in (message.pitchspeed, message.rollspeed, message.yawspeed)
            ]
            lean = self._lean_filter.take(now, (pitch, roll), (rates[0], rates[1]))
            motion = self._odometry.take(lean, yaw, rates[2], along_nose(self.vehicle, yaw, now))
            self.vehicle = replace(
                self.vehicle, attitude=(roll, pitch, yaw % 360), attitude_at=now, motion=motion
            )

    def throttle(self, system_id: int, message: Any, now: float) -> None:
        """Take VFR_HUD. A throttle backwards is below 0, in 16 bits without a sign."""
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return
        percent = min(message.throttle, (1 << 16) - message.throttle)
        since = None if percent < PUSHES else self.vehicle.pushes_since
        since = now if percent >= PUSHES and since is None else since
        self.vehicle = replace(self.vehicle, pushes_since=since, throttle_at=now)

    def mission(self, system_id: int, message: Any, now: float) -> bool:
        """Take MISSION_CURRENT; True when it is our vehicle's. What old firmware leaves out is not known."""
        if self.vehicle is None or system_id != self.vehicle.system_id:
            return False
        states = {int(state) for state in MissionState}
        told = Mission(
            item=int(message.seq),
            total=None if message.total in _NO_TOTAL else int(message.total),
            state=MissionState(message.mission_state if message.mission_state in states else 0),
            id=_mission_id(bytes(message.get_msgbuf())),
            at=now,
        )
        before = self.vehicle.mission
        reached = before.reached if before is not None and not told.replaces(before) else None
        # With an earlier item the mission began anew, or somebody set the item.
        if before is not None and reached is not None and told.item >= reached:
            told = replace(told, reached=reached, reached_at=before.reached_at)
        self.vehicle = replace(self.vehicle, mission=told)
        return True

    def item_reached(self, system_id: int, message: Any, now: float) -> bool:
        """Take MISSION_ITEM_REACHED; True when it is our vehicle's, whose current item is known."""
        if self.vehicle is None or system_id != self.vehicle.system_id or self.vehicle.mission is None:
            return False
        reached = replace(self.vehicle.mission, reached=int(message.seq), reached_at=now)
        self.vehicle = replace(self.vehicle, mission=reached)
        return True

    def time(self, system_id: int, message: Any, now: float) -> None:
        """Take SYSTEM_TIME. An autopilot without the time sends 0 or a year long ago: that is ignored."""
        if not self.is_ours(system_id):
            return
        self._note_uptime(message)
        seconds = message.time_unix_usec / 1e6
        if self.vehicle is not None and is_set(seconds):
            self.vehicle = replace(self.vehicle, clock=seconds - now, clock_at=now)

    def tick(self, now: float) -> None:
        """Forget a position, an attitude, a throttle and the mission's state that are older than 5 s."""
        vehicle = self.vehicle
        if vehicle is None:
            return
        if vehicle.position is not None and now - (vehicle.position_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = vehicle = replace(vehicle, position=None, speed=None, course=None)
        if vehicle.attitude is not None and now - (vehicle.attitude_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = vehicle = replace(vehicle, attitude=None, motion=None)
        if vehicle.pushes_since is not None and now - (vehicle.throttle_at or 0.0) > POSITION_LIFETIME:
            self.vehicle = vehicle = replace(vehicle, pushes_since=None)
        mission = vehicle.mission
        if mission is not None and mission.state and now - mission.at > POSITION_LIFETIME:
            unknown = replace(mission, fresh=False, state=MissionState.UNKNOWN)
            self.vehicle = replace(vehicle, mission=unknown)

    def _note_uptime(self, message: Any) -> None:
        """Count a reboot where `time_boot_ms`, which many messages carry, has run backwards."""
        before, self._uptime = self._uptime, int(message.time_boot_ms)
        if self.vehicle is not None and _BACKWARDS < before - self._uptime < _WRAPS:
            self.vehicle = replace(self.vehicle, reboots=self.vehicle.reboots + 1)

    def _adopts(self, system_id: int, now: float) -> bool:
        if system_id == self._configured:
            return True
        if now - self._candidate_at > SILENCE:
            self._candidate, self._candidate_since = system_id, now
        if system_id != self._candidate:
            return False
        self._candidate_at = now
        return now - self._candidate_since >= SETTLE


def _in_mode(vehicle: Vehicle, mode: int) -> Vehicle:
    """Return `vehicle`, whose mission must be reported again before it counts where the mode is a new one."""
    if vehicle.mission is None or mode == vehicle.custom_mode:
        return vehicle
    return replace(vehicle, mission=replace(vehicle.mission, fresh=False, reached=None))


def _mission_id(frame: bytes) -> int:
    """Return the id of the mission's content in a frame of MISSION_CURRENT, 0 where it has none."""
    if frame[0] == mavlink.PROTOCOL_MARKER_V1:
        return 0
    payload = frame[_HEADER : _HEADER + frame[1]]
    return int.from_bytes(payload[_MISSION_ID].ljust(4, b"\0"), "little")


def _course(north: int, east: int) -> float | None:
    """Return the direction of a velocity in degrees clockwise from north, None where it is 0."""
    return math.degrees(math.atan2(east, north)) % 360 if north or east else None
