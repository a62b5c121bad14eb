"""Simulates a PX4 rover with car steering, as a companion computer and a ground station see it on MAVLink.

It differs from `SimulatedAutopilot` in this: modes have a main and a sub mode; a mode command is
acknowledged twice; a new mode is reported with the next heartbeat, or sooner by CURRENT_MODE where that is
requested; LOITER circles back; OFFBOARD needs setpoints before and during it; the loss of the companion is
reported and changes nothing, but the loss of a MANUAL_CONTROL stream does (`manual_control`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import manual_control
from companion.sim.field.autopilot import BY_ITSELF, COMPANION, SYSTEM, SimulatedAutopilot
from companion.sim.field.manual_control import Action, Excepted, ManualControl
from companion.sim.field.parameters import INT32, REAL32, Row
from companion.sim.field.router import Port
from companion.sim.field.rover import MotorDrive, Rover

SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)
CURRENT_MODE = int(mavlink.MAVLINK_MSG_ID_CURRENT_MODE)
SETPOINTS_FIRST = 0.5
"""Seconds for which setpoints must have come before OFFBOARD is accepted."""
COMPANION_LOST_AFTER = 6.9
STILL = 0.05
"""m/s below which a setpoint means standstill; faster setpoints are not simulated."""
TO_HOLD = 5
"""Value of COM_OBL_RC_ACT with which the rover goes to LOITER, not RTL, when setpoints stop."""
_VELOCITY_IGNORED = 0b11_1000


class Px4Mode(enum.IntEnum):
    """A mode; its value is HEARTBEAT.custom_mode: main mode << 16 | sub mode << 24."""

    MANUAL = 0x0001_0000
    POSITION = 0x0003_0000
    LOITER = 0x0304_0000
    MISSION = 0x0404_0000
    RTL = 0x0504_0000
    OFFBOARD = 0x0006_0000


PARAMETERS: tuple[Row, ...] = (
    ("MAV_SYS_ID", INT32, 1, 1, 250),
    ("MAV_0_FORWARD", INT32, 1, 0, 1),
    ("MAV_1_FORWARD", INT32, 1, 0, 1),
    ("COM_OF_LOSS_T", REAL32, 0.5, 0.0, 60.0),
    ("COM_OBL_RC_ACT", INT32, 0, 0, 7),
    ("NAV_DLL_ACT", INT32, 0, 0, 6),
    ("RO_SPEED_LIM", REAL32, 2.5, 0.0, 5.0),
    *manual_control.PARAMETERS,
)
_BY_HAND = frozenset({Px4Mode.MANUAL, Px4Mode.POSITION})
_EXCEPTED = {
    Px4Mode.MISSION: Excepted.MISSION,
    Px4Mode.LOITER: Excepted.AUTO,
    Px4Mode.RTL: Excepted.AUTO,
    Px4Mode.OFFBOARD: Excepted.OFFBOARD,
}
_FAILSAFE = {Action.HOLD: Px4Mode.LOITER, Action.RETURN: Px4Mode.RTL}


class Px4(SimulatedAutopilot):
    """A PX4 autopilot that boots disarmed in LOITER. It ignores setpoints other than zero velocity."""

    modes: ClassVar[type[enum.IntEnum]] = Px4Mode
    boots_in: ClassVar[enum.IntEnum] = Px4Mode.LOITER
    mission: ClassVar[enum.IntEnum] = Px4Mode.MISSION
    first_item: ClassVar[int] = 0
    parameter_table: ClassVar[Sequence[Row]] = PARAMETERS
    speeds: ClassVar[tuple[str, ...]] = ("RO_SPEED_LIM",)

    _fed_since = _fed_at = -math.inf
    _companion_at: float | None = None
    _acknowledged = 0

    def __init__(self, rover: Rover, send: Callable[[Port, bytes], bool]) -> None:
        super().__init__(rover, send)
        self._manual = ManualControl(self.parameters)
        self._mode_set: enum.IntEnum = self.mode

    def receive(self, port: Port, frame: Any) -> None:
        super().receive(port, frame)
        kind = frame.get_type()
        if kind == "HEARTBEAT" and frame.get_srcComponent() == COMPANION:
            self._companion_at = self.rover.time
        elif kind == "SET_POSITION_TARGET_LOCAL_NED" and _is_still(frame):
            if not self._fed:
                self._fed_since = self.rover.time
            self._fed_at = self.rover.time
        elif kind == "MANUAL_CONTROL" and frame.target in (0, SYSTEM):
            self._manual.received(self.rover.time)

    def set_mode(self, mode: enum.IntEnum, by: str) -> None:
        if by != BY_ITSELF:
            self._mode_set = mode
            self._manual.mode_set()
        super().set_mode(mode, by)

    def reboot(self, seconds: float, checks: float = 0.0) -> None:
        super().reboot(seconds, checks)
        self._manual, self._mode_set = ManualControl(self.parameters), self.mode
        self._fed_since = self._fed_at = -math.inf
        self._companion_at = None

    def poll(self, now: float) -> None:
        if self.mode is Px4Mode.OFFBOARD and not self._fed:
            to_hold = self.parameters["COM_OBL_RC_ACT"] == TO_HOLD
            self.set_mode(Px4Mode.LOITER if to_hold else Px4Mode.RTL, BY_ITSELF)
        self._follow_manual_control()
        if self._companion_at is not None and self.rover.time - self._companion_at > COMPANION_LOST_AFTER:
            self._companion_at = None
            self._warn(b"Connection to mission computer lost")
        super().poll(now)

    def find_mode(self, custom: int, sub: int) -> enum.IntEnum | None:
        """Finds a mode by main and sub mode, or by the heartbeat's number (in the old SET_MODE message)."""
        wanted = custom if custom > 0xFF else custom << 16 | sub << 24
        return Px4Mode(wanted) if wanted in {int(mode) for mode in Px4Mode} else None

    def may_enter(self, mode: enum.IntEnum) -> bool:
        fed_for = self.rover.time - self._fed_since
        if mode in _BY_HAND and self._manual.lost(self.rover.time):
            return False
        return mode is not Px4Mode.OFFBOARD or (self._fed and fed_for >= SETPOINTS_FIRST)

    def restarts_mission(self) -> bool:
        return False

    def mission_state(self) -> int:
        if self.tour.complete:
            return self.tour.state
        if self.mode is self.mission:
            return int(mavlink.MISSION_STATE_ACTIVE)
        return int(mavlink.MISSION_STATE_PAUSED) if self.tour.started else self.tour.state

    def mission_completed(self) -> None:
        """Goes to LOITER, as PX4 does by itself; it does so again when MISSION is set after that."""
        self.set_mode(Px4Mode.LOITER, BY_ITSELF)

    def set_reverse(self, *, on: bool) -> bool:  # noqa: ARG002 - there is no such command
        return False

    def results(self, command: int, result: int) -> list[int]:
        """Returns two results that contradict each other for a mode command, in alternating order.

        PX4 does that: a companion must read the mode back and must not rely on an acknowledgement.
        """
        if command != SET_MODE:
            return [result]
        self._acknowledged += 1
        both = [result, int(mavlink.MAV_RESULT_UNSUPPORTED)]
        return both if self._acknowledged % 2 else both[::-1]

    def periods(self) -> dict[int, float]:
        return {**super().periods(), CURRENT_MODE: math.inf}

    def message(self, number: int) -> Any:
        if number == CURRENT_MODE:
            return mavlink.MAVLink_current_mode_message(0, int(self.mode), int(self.mode))
        return super().message(number)

    def heartbeat(self) -> Any:
        bits = int(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        if self.mode in (Px4Mode.MANUAL, Px4Mode.POSITION):
            bits |= int(mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
        else:
            bits |= int(mavlink.MAV_MODE_FLAG_AUTO_ENABLED)
        if self.armed:
            bits |= int(mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        status = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_PX4, bits, int(self.mode), status, 3
        )

    def drives(self) -> MotorDrive:
        # Sticks of MANUAL_CONTROL that are not centred are not simulated.
        by_hand = (
            MotorDrive.BRAKE
            if self.parameters["COM_RC_IN_MODE"] == manual_control.MAVLINK_ONLY
            else MotorDrive.HAND
        )
        return {
            Px4Mode.MISSION: MotorDrive.FOLLOW,
            **dict.fromkeys(_BY_HAND, by_hand),
            Px4Mode.LOITER: MotorDrive.CIRCLE,
            Px4Mode.RTL: MotorDrive.HOME,
        }.get(Px4Mode(self.mode), MotorDrive.BRAKE)

    def _follow_manual_control(self) -> None:
        kind = _EXCEPTED.get(Px4Mode(self._mode_set))
        action = self._manual.poll(kind, self.rover.time, armed=self.armed)
        if action is not None and self.mode is not _FAILSAFE[action]:
            self.set_mode(_FAILSAFE[action], BY_ITSELF)
            self._warn(b"Manual control lost")

    def _mode_changed(self) -> None:
        """Does nothing: PX4 reports a change with its next regular heartbeat."""

    def _forward(self, port: Port, frame: Any) -> None:
        if self.parameters["MAV_0_FORWARD"] and self.parameters["MAV_1_FORWARD"]:
            super()._forward(port, frame)

    @property
    def _fed(self) -> bool:
        return self.rover.time - self._fed_at <= self.parameters["COM_OF_LOSS_T"]

    def _warn(self, text: bytes) -> None:
        for port in Port:
            self.send(port, mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, text))


def _is_still(frame: Any) -> bool:
    speed = math.hypot(frame.vx, frame.vy)
    return frame.type_mask & _VELOCITY_IGNORED == 0 and speed < STILL
