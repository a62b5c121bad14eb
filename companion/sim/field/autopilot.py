"""Simulates ArduPilot Rover as a companion computer and a ground station see it on MAVLink.

It routes between its two ports, obeys modes, arming and parameters, and drives the rover. It has no sockets
and no clock of its own: parsed frames and times come in, and frames leave through `send(port, frame)`, which
returns whether there was a peer to send to.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import mission_items, telemetry
from companion.sim.field.commands import Commands
from companion.sim.field.guided import GuidedTargets
from companion.sim.field.mission import SimulatedMission
from companion.sim.field.modes import Mode
from companion.sim.field.parameters import ARDUPILOT, Parameters, Row, SimulatedParameter
from companion.sim.field.router import Port, Router
from companion.sim.field.rover import MotorDrive, Rover

if TYPE_CHECKING:
    from companion.sim.field.scripting import Scripting


SYSTEM = 1
COMPONENT = 1
COMPANION = 191
PARAMETER_GAP = 0.02
ARMS_ITSELF = (3, 4)
"""Values of ARMING_REQUIRE with which it arms itself once after a boot."""
ARMS_AGAIN = 5.0
"""s after which it tries again to arm itself."""
_POSITION = int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
_POSITION_RATES = {Port.GCS: "MAV1_POSITION", Port.COMPANION: "MAV2_POSITION"}
MISSION_CURRENT = int(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
MISSION_PERIOD = 1.0
LOGGED_MODES = 200
HAND = "hand"
BY_ITSELF = "autopilot"


@dataclass(frozen=True)
class ModeChange:
    """An entry of the mode log: rover time in s, the new mode, and who set it.

    by: "companion", also where the script set the mode for it, "gcs", "hand", "script", or "autopilot" where
    it did so itself.
    """

    t: float
    mode: enum.IntEnum
    by: str


class SimulatedAutopilot:
    """An autopilot that boots disarmed in HOLD, and enters HOLD from every mode, whoever commands it.

    A subclass simulates another kind. It overrides the class variables and the methods from `find_mode` to
    `_mode_changed`; the rest is the same for all.
    """

    modes: ClassVar[type[enum.IntEnum]] = Mode
    boots_in: ClassVar[enum.IntEnum] = Mode.HOLD
    mission: ClassVar[enum.IntEnum] = Mode.AUTO
    first_item: ClassVar[int] = 1
    """Number of a mission's first item: ArduPilot's item 0 is the home position."""
    parameter_table: ClassVar[Sequence[Row]] = ARDUPILOT
    speeds: ClassVar[tuple[str, ...]] = ("WP_SPEED", "CRUISE_SPEED")
    """Names of the speed parameters. The first that is not 0 counts; the constructor sets the last."""

    def __init__(self, rover: Rover, send: Callable[[Port, bytes], bool]) -> None:
        self.rover = rover
        self.parameters = Parameters(self.parameter_table)
        self.parameters.set(self.speeds[-1], rover.cruise_speed)
        self.mode = self.boots_in
        self.mode_by = ""
        self.armed = False
        self.tour = SimulatedMission(rover, self.first_item)
        self.targets = GuidedTargets(rover)
        self.script: Scripting | None = None
        self.obstacles_at: float | None = None
        self.mode_log: deque[ModeChange] = deque(maxlen=LOGGED_MODES)
        self.bytes_from_companion = 0
        self.router = Router(SYSTEM, COMPONENT)
        self.streams = self._booted_streams()
        self._send = send
        self._mav = {port: mavlink.MAVLink(None, SYSTEM, COMPONENT) for port in Port}
        self._commands = Commands(self)
        self._next_heartbeat = 0.0
        self._boots_until = -math.inf
        self._arms_itself_at = math.inf
        self._listing: dict[Port, deque[SimulatedParameter]] = {port: deque() for port in Port}
        self._next_listed = dict.fromkeys(Port, 0.0)
        self._apply()

    def pass_to_script(self, port: Port, datagram: bytes) -> None:
        """Passes a datagram on to the script unchecked: ArduPilot's scripts receive damaged frames too."""
        if self.script is not None and not self.boots:
            self.script.receive(datagram, channel=list(Port).index(port))

    def receive(self, port: Port, frame: Any) -> None:
        """Routes and executes one parsed frame that came in on `port`."""
        if self.boots:
            return
        if frame.get_type() == "OBSTACLE_DISTANCE":
            self.obstacles_at = self.rover.time
        route = self.router.decide(port, frame)
        if route.forward:
            self._forward(port.other, frame)
        if route.execute:
            self._execute(port, frame)

    def poll(self, now: float) -> None:
        """Sends what is due at `now` (s, any steady clock): heartbeat, streams, parameters of a list.

        It runs the script, too, whose clock is the rover's time. While it boots it does nothing.
        """
        if self.boots:
            return
        if self.script is not None:
            self.script.poll()
        if self.rover.time >= self._arms_itself_at:
            self._arms_itself_at = math.inf if self.arm(on=True) else self.rover.time + ARMS_AGAIN
        if self.targets.lapse():
            self._apply()
            self.send_text(b"target not received last 3secs, stopping", mavlink.MAV_SEVERITY_WARNING)
        if self.armed and self.mode is self.mission:
            self._drive_mission()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + telemetry.HEARTBEAT_PERIOD
            self._send_heartbeat()
        for port, streams in self.streams.items():
            for number in streams.due(now):
                self.send(port, self.message(number))
            if self._listing[port] and now >= self._next_listed[port]:
                self._next_listed[port] = now + PARAMETER_GAP
                self.send_parameter(port, self._listing[port].popleft())

    @property
    def boots(self) -> bool:
        """Whether it boots: it is deaf and silent."""
        return self.rover.time < self._boots_until

    def reboot(self, seconds: float, checks: float = 0.0) -> None:
        """Reboots: the motors are off, for so long it is deaf and silent, and then all but parameters is new.

        It is disarmed then, in INITIAL_MODE, and its clock has begun anew. No message says that it rebooted.
        With an ARMING_REQUIRE of `ARMS_ITSELF` it arms itself `checks` s later, unless the script forbids it.
        """
        self._boots_until = self.rover.booted_at = self.rover.time + seconds
        self.armed = False
        self.rover.reversed = False
        initial, require = self.parameters.find("INITIAL_MODE"), self.parameters.find("ARMING_REQUIRE")
        arms = require is not None and require.value in ARMS_ITSELF
        self._arms_itself_at = self._boots_until + checks if arms else math.inf
        mode = self.find_mode(int(initial.value), 0) if initial is not None else None
        self.set_mode(self.boots_in if mode is None else mode, BY_ITSELF)
        self.mode_by = BY_ITSELF
        if self.tour.complete:
            self.tour.begin_anew()
        self.router = Router(SYSTEM, COMPONENT)
        self.streams = self._booted_streams()
        self._listing = {port: deque() for port in Port}
        self.obstacles_at = None
        if self.script is not None:
            self.script.boot()

    def send(self, port: Port, message: Any) -> None:
        """Sends a message of the autopilot's own on one port."""
        if self.boots:
            return
        mav = self._mav[port]
        frame = message.pack(mav)
        mav.seq = (mav.seq + 1) % 256
        self._send(port, frame)

    def send_parameter(self, port: Port, row: SimulatedParameter) -> None:
        """Sends PARAM_VALUE of one parameter on one port."""
        self.send(
            port,
            mavlink.MAVLink_param_value_message(
                row.name.encode(), row.value, row.kind, len(self.parameters), row.index
            ),
        )

    def set_mode(self, mode: enum.IntEnum, by: str) -> None:
        """Enters `mode` and reports the change on both ports. by: who set it, for the mode log."""
        if mode is self.mission and self.mode is not self.mission and self.restarts_mission():
            self.tour.begin_anew()
        changed = mode is not self.mode
        self.mode = mode
        if changed:
            self.targets.forget()
        self._apply()
        if changed:
            self.mode_by = by
            self.mode_log.append(ModeChange(self.rover.time, mode, by))
            self._mode_changed()

    def set_reverse(self, *, on: bool) -> bool:
        """Makes its missions drive backwards, or forwards again, until told otherwise. False: it cannot."""
        self.rover.reversed = on
        return True

    def set_item(self, number: int) -> bool:
        """Makes an item of the mission the current one, and tells it on both ports. False: it cannot."""
        if not self.tour.set_current(number):
            return False
        for port in Port:
            self.send(port, self.message(MISSION_CURRENT))
        return True

    def arm(self, *, on: bool) -> bool:
        """Arms or disarms. Returns False when the script forbids arming; ARMING_CHECK 0 ignores it."""
        if on and self.script is not None and self.parameters["ARMING_CHECK"]:
            why = self.script.forbids_arming()
            if why:
                self.send_text(f"Arm: {why}"[:50].encode(), mavlink.MAV_SEVERITY_CRITICAL)
                return False
        changed = on is not self.armed
        self.armed = on
        self._apply()
        if changed:
            self._mode_changed()
            self.send_text(b"Throttle armed" if on else b"Throttle disarmed", mavlink.MAV_SEVERITY_INFO)
        return True

    def set_parameter(self, name: str, value: float) -> SimulatedParameter | None:
        """Sets a parameter as `Parameters.set` does; a new speed takes effect at once."""
        row = self.parameters.set(name, value)
        self.rover.cruise_speed = next((v for name in self.speeds if (v := self.parameters[name])), 0.0)
        return row

    def find_mode(self, custom: int, _sub: int) -> enum.IntEnum | None:
        """Returns the mode that a command asks for; None when there is no such mode."""
        return Mode(custom) if custom in {int(mode) for mode in Mode} else None

    def may_enter(self, _mode: enum.IntEnum) -> bool:
        """Whether a command for this mode is obeyed now."""
        return True

    def restarts_mission(self) -> bool:
        """Whether the mission starts over as its mode is entered; a complete one does so in any case."""
        return bool(self.parameters["MIS_RESTART"]) or self.tour.complete

    def mission_state(self) -> int:
        """MISSION_STATE. ArduPilot calls a mission not started whenever it does not drive it."""
        active = self.mode is self.mission and not self.tour.complete
        return int(mavlink.MISSION_STATE_ACTIVE) if active else self.tour.state

    def mission_completed(self) -> None:
        """Called while the last item is reached: ArduPilot stays in its mode and stands."""
        self._apply()

    def results(self, _command: int, result: int) -> list[int]:
        """Returns the results of the acknowledgements that a command gets, in order."""
        return [result]

    def periods(self) -> dict[int, float]:
        """Returns each message id that can be streamed with its default period in s; inf: only on request."""
        known = {number: period for number, (_, period) in telemetry.MESSAGES.items()}
        return {**known, MISSION_CURRENT: MISSION_PERIOD}

    def _booted_streams(self) -> dict[Port, telemetry.Streams]:
        """Returns each port's streams as after a boot: a parameter says how often a position comes."""
        streams = {}
        for port in Port:
            periods, rate = self.periods(), self.parameters.find(_POSITION_RATES[port])
            if rate is not None:
                periods[_POSITION] = 1.0 / rate.value if rate.value else math.inf
            streams[port] = telemetry.Streams(periods)
        return streams

    def message(self, number: int) -> Any:
        """Makes the message of one of the ids of `periods` with its values now; None for other ids."""
        if number == MISSION_CURRENT:
            return self.tour.current(self.mission_state(), in_mode=self.mode is self.mission)
        known = telemetry.MESSAGES.get(number)
        return None if known is None else known[0](self.rover)

    def heartbeat(self) -> Any:
        return telemetry.heartbeat(Mode(self.mode), armed=self.armed)

    def drives(self) -> MotorDrive:
        """Returns what the mode makes the motors of an armed rover do."""
        if self.tour.complete and self.mode is self.mission:
            return MotorDrive.HOLD
        known = {
            Mode.AUTO: MotorDrive.FOLLOW,
            Mode.GUIDED: MotorDrive.STOP if self.rover.target is None else MotorDrive.TARGET,
            Mode.MANUAL: MotorDrive.HAND,
            Mode.STEERING: MotorDrive.HAND,
        }
        return known.get(Mode(self.mode), MotorDrive.HOLD)

    def _drive_mission(self) -> None:
        for reached in self.tour.advance():
            for port in Port:
                self.send(port, reached)
        if self.tour.complete:
            self.mission_completed()

    def _mode_changed(self) -> None:
        """Called when mode or arming has changed: ArduPilot sends a heartbeat at once."""
        self._send_heartbeat()

    def _apply(self) -> None:
        self.rover.drive = self.drives() if self.armed else MotorDrive.OFF

    def _send_heartbeat(self) -> None:
        for port in Port:
            self.send(port, self.heartbeat())

    def send_text(self, text: bytes, severity: int) -> None:
        """Sends a STATUSTEXT of at most 50 bytes on both ports."""
        for port in Port:
            self.send(port, mavlink.MAVLink_statustext_message(severity, text))

    def _forward(self, port: Port, frame: Any) -> None:
        raw = bytes(frame.get_msgbuf())
        sent = self._send(port, raw)
        if sent and port is Port.GCS and frame.get_srcComponent() == COMPANION:
            self.bytes_from_companion += len(raw)

    def _execute(self, port: Port, frame: Any) -> None:
        kind = frame.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            self._commands.run(port, frame)
        elif kind == "SET_MODE":
            asked = [frame.base_mode, frame.custom_mode]
            result = self._commands.set_mode(port, [float(value) for value in asked])
            self._commands.acknowledge(port, frame, int(mavlink.MAVLINK_MSG_ID_SET_MODE), result)
        elif kind.startswith("MISSION_"):
            for reply in mission_items.replies(self.tour, frame):
                self.send(port, reply)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED" and self.mode is Mode.GUIDED:
            self.targets.hear(frame)
            self._apply()
        elif kind == "PARAM_REQUEST_LIST":
            self._listing[port] = deque(self.parameters.rows())
        elif kind == "PARAM_REQUEST_READ":
            row = self.parameters.find(frame.param_id, frame.param_index)
            if row is not None:
                self.send_parameter(port, row)
        elif kind == "PARAM_SET":
            row = self.set_parameter(frame.param_id, frame.param_value)
            if row is not None:
                for at in Port:
                    self.send_parameter(at, row)
