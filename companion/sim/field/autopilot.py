"""The autopilot: ArduPilot Rover as a companion computer and a ground station see it on MAVLink.

It routes between its two ports, obeys modes, arming and parameters, and drives the rover. No sockets and no
clock of its own: parsed frames and times come in, frames leave through `send(port, frame)`, which says
whether anybody was there to send to.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field import telemetry
from companion.sim.field.commands import Commands
from companion.sim.field.modes import Mode
from companion.sim.field.parameters import ARDUPILOT, Parameter, Parameters, Row
from companion.sim.field.router import Port, Router
from companion.sim.field.rover import Drive, Rover

if TYPE_CHECKING:
    from companion.sim.field.scripting import Scripting


SYSTEM = 1
COMPONENT = 1
COMPANION = 191
PARAMETER_GAP = 0.02
LOGGED_MODES = 200
HAND = "hand"


@dataclass(frozen=True)
class ModeChange:
    """An entry of the mode log: rover time in s, the new mode, and "companion", "gcs", "hand" or "script"."""

    t: float
    mode: enum.IntEnum
    by: str


class Autopilot:
    """Boots disarmed in HOLD. Accepts HOLD in every mode, whoever asks.

    Another kind is a class below this one. It says otherwise in the class variables and in the methods from
    `find_mode` to `_beat`; the rest is the same for all.
    """

    modes: ClassVar[type[enum.IntEnum]] = Mode
    boots_in: ClassVar[enum.IntEnum] = Mode.HOLD
    mission: ClassVar[enum.IntEnum] = Mode.AUTO
    parameter_table: ClassVar[Sequence[Row]] = ARDUPILOT
    speeds: ClassVar[tuple[str, ...]] = ("WP_SPEED", "CRUISE_SPEED")
    """Parameters of the speed along the trail: the first that is not 0 counts; the last is set at first."""

    def __init__(self, rover: Rover, send: Callable[[Port, bytes], bool]) -> None:
        self.rover = rover
        self.parameters = Parameters(self.parameter_table)
        self.parameters.set(self.speeds[-1], rover.cruise_speed)
        self.mode = self.boots_in
        self.mode_by = ""
        self.armed = False
        self.script: Scripting | None = None
        self.obstacles_at: float | None = None
        self.mode_log: deque[ModeChange] = deque(maxlen=LOGGED_MODES)
        self.bytes_from_companion = 0
        self.router = Router(SYSTEM, COMPONENT)
        self.streams = {port: telemetry.Streams(self.periods()) for port in Port}
        self._send = send
        self._mav = {port: mavlink.MAVLink(None, SYSTEM, COMPONENT) for port in Port}
        self._commands = Commands(self)
        self._next_heartbeat = 0.0
        self._listing: dict[Port, deque[Parameter]] = {port: deque() for port in Port}
        self._next_listed = dict.fromkeys(Port, 0.0)
        self._apply()

    def overhear(self, port: Port, datagram: bytes) -> None:
        """What came in on `port`, before anybody checks it: scripts hear damaged frames too."""
        if self.script is not None:
            self.script.hear(datagram, channel=list(Port).index(port))

    def receive(self, port: Port, frame: Any) -> None:
        """Route and obey one parsed frame that came in on `port`."""
        if frame.get_type() == "OBSTACLE_DISTANCE":
            self.obstacles_at = self.rover.time
        route = self.router.decide(port, frame)
        if route.forward:
            self._forward(port.other, frame)
        if route.execute:
            self._execute(port, frame)

    def poll(self, now: float) -> None:
        """Say what is due at `now` (s, any steady clock): heartbeat, streams, parameters being listed.
        A script runs by the rover's time."""
        if self.script is not None:
            self.script.poll()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + telemetry.HEARTBEAT_PERIOD
            self._say_heartbeat()
        for port, streams in self.streams.items():
            for number in streams.due(now):
                self.say(port, self.message(number))
            if self._listing[port] and now >= self._next_listed[port]:
                self._next_listed[port] = now + PARAMETER_GAP
                self.say_parameter(port, self._listing[port].popleft())

    def say(self, port: Port, message: Any) -> None:
        """Send a message of the autopilot's own on one port."""
        mav = self._mav[port]
        frame = message.pack(mav)
        mav.seq = (mav.seq + 1) % 256
        self._send(port, frame)

    def say_parameter(self, port: Port, row: Parameter) -> None:
        self.say(
            port,
            mavlink.MAVLink_param_value_message(
                row.name.encode(), row.value, row.kind, len(self.parameters), row.index
            ),
        )

    def set_mode(self, mode: enum.IntEnum, by: str) -> None:
        """Enter `mode`, and tell both ports."""
        if mode is self.mission and self.mode is not self.mission and self.restarts_mission():
            self.rover.restart_mission()
        changed = mode is not self.mode
        self.mode = mode
        self._apply()
        if changed:
            self.mode_by = by
            self.mode_log.append(ModeChange(self.rover.time, mode, by))
            self._beat()

    def arm(self, *, on: bool) -> bool:
        """False: a script forbids it. Only where arming checks are on (ARMING_CHECK) it is asked."""
        if on and self.script is not None and self.parameters["ARMING_CHECK"]:
            why = self.script.forbids_arming()
            if why:
                self.tell(f"Arm: {why}"[:50].encode(), mavlink.MAV_SEVERITY_CRITICAL)
                return False
        changed = on is not self.armed
        self.armed = on
        self._apply()
        if changed:
            self._beat()
            self.tell(b"Throttle armed" if on else b"Throttle disarmed", mavlink.MAV_SEVERITY_INFO)
        return True

    def set_parameter(self, name: str, value: float) -> Parameter | None:
        """As `Parameters.set`; what the rover drives by takes effect at once."""
        row = self.parameters.set(name, value)
        self.rover.cruise_speed = next((v for name in self.speeds if (v := self.parameters[name])), 0.0)
        return row

    def find_mode(self, custom: int, _sub: int) -> enum.IntEnum | None:
        """The mode that a command asks for; None when there is none."""
        return Mode(custom) if custom in {int(mode) for mode in Mode} else None

    def may_enter(self, _mode: enum.IntEnum) -> bool:
        """Whether a command for the mode is obeyed now."""
        return True

    def restarts_mission(self) -> bool:
        """Whether the mission begins anew each time its mode is entered."""
        return bool(self.parameters["MIS_RESTART"])

    def results(self, _command: int, result: int) -> list[int]:
        """The acknowledgements that a command gets, in order."""
        return [result]

    def periods(self) -> dict[int, float]:
        """Every message that can be streamed, and its period in s unless somebody asks; inf: never."""
        return {number: period for number, (_, period) in telemetry.MESSAGES.items()}

    def message(self, number: int) -> Any:
        """One of `periods` as it would be said now; None when there is no such message."""
        known = telemetry.MESSAGES.get(number)
        return None if known is None else known[0](self.rover)

    def heartbeat(self) -> Any:
        return telemetry.heartbeat(Mode(self.mode), armed=self.armed)

    def drives(self) -> Drive:
        """What the mode asks of the motors of an armed rover."""
        return {Mode.AUTO: Drive.FOLLOW, Mode.MANUAL: Drive.HAND}.get(Mode(self.mode), Drive.HOLD)

    def _beat(self) -> None:
        """Mode or arming has changed: the heartbeat tells it at once."""
        self._say_heartbeat()

    def _apply(self) -> None:
        self.rover.drive = self.drives() if self.armed else Drive.OFF

    def _say_heartbeat(self) -> None:
        for port in Port:
            self.say(port, self.heartbeat())

    def tell(self, text: bytes, severity: int) -> None:
        """A text of at most 50 bytes, on both ports."""
        for port in Port:
            self.say(port, mavlink.MAVLink_statustext_message(severity, text))

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
        elif kind == "PARAM_REQUEST_LIST":
            self._listing[port] = deque(self.parameters.rows())
        elif kind == "PARAM_REQUEST_READ":
            row = self.parameters.find(frame.param_id, frame.param_index)
            if row is not None:
                self.say_parameter(port, row)
        elif kind == "PARAM_SET":
            row = self.set_parameter(frame.param_id, frame.param_value)
            if row is not None:
                for at in Port:
                    self.say_parameter(at, row)
