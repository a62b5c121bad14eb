"""ArduPilot's bindings under the shipped script, in virtual time, misbehaving as a test wants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.resources import resource
from companion.sim.field.scripting import Scripting
from companion.wire.ids import Policy, State, heartbeat_mode

SOURCE = resource("config/ardupilot/anytraverse.lua").read_text()
MANUAL, HOLD, AUTO, RTL, GUIDED = 0, 4, 10, 11, 15
BY_RC, BY_GCS, MISSION_COMMAND, SCRIPTING = 1, 2, 41, 32
CYCLE = 0.1
HELD = "HOLD: companion silent. AUTO again = go blind"


@dataclass(frozen=True)
class Said:
    """A text of the autopilot's; t in s since the start."""

    t: float
    severity: int
    text: str
    raw: bytes


class Board:
    """An autopilot in AUTO, armed, as its scripts see it, and the script on it. `pass_time` moves it."""

    def __init__(self, *, start_ms: int = 0, policy: Policy = Policy.HOLD, **parameters: float) -> None:
        self.parameters = {"SYSID_THISMAV": 1.0, "AVOID_ENABLE": 3.0, "OA_TYPE": 0.0, **parameters}
        self.ms = self._start_ms = start_ms
        self.mode_now, self.reason, self.armed = AUTO, BY_GCS, True
        self.obeys = True
        self.broken: set[str] = set()
        self.moves_at = 1.0
        self.sensors, self.status = 0, 0
        self.switches: dict[int, int] = {}
        self.said: list[Said] = []
        self.sent: list[tuple[int, int, bytes]] = []
        self.set_modes: list[tuple[float, int, int, bool]] = []
        self.policy = policy
        self.companion = mavlink.MAVLink(None, 1, 191)
        self.scripting = Scripting(SOURCE, "anytraverse.lua", self)
        self.pass_time(CYCLE)

    # What scripts see.

    def millis(self) -> int:
        return self.ms

    def mode(self) -> int:
        self._break("mode")
        return self.mode_now

    def mode_reason(self) -> int:
        return self.reason

    def set_mode(self, number: int) -> bool:
        self.set_modes.append((self.t, number, self.mode_now, self.armed))
        if self.obeys:
            self.mode_now, self.reason = number, SCRIPTING
        return self.obeys

    def is_armed(self) -> bool:
        self._break("is_armed")
        return self.armed

    def speed(self) -> float:
        self._break("speed")
        return self.moves_at

    def send_text(self, severity: int, text: bytes) -> None:
        self._break("send_text")
        assert len(text) <= 50, text
        self.said.append(Said(self.t, severity, text.decode(errors="replace"), text))

    def send_message(self, channel: int, number: int, payload: bytes) -> bool:
        self.sent.append((channel, number, payload))
        return True

    def parameter(self, name: str) -> float | None:
        self._break("parameter")
        return self.parameters.get(name)

    def add_parameter(self, name: str, default: float) -> None:
        self._break("add_parameter")
        self.parameters.setdefault(name, default)

    def proximity_sensors(self) -> int:
        return self.sensors

    def proximity_status(self) -> int:
        return self.status

    def switch(self, function: int) -> int | None:
        return self.switches.get(function)

    # What tests do.

    @property
    def t(self) -> float:
        return (self.ms - self._start_ms) / 1000

    def texts(self, severity: int = 7) -> list[str]:
        """Said at this severity or a worse one."""
        return [said.text for said in self.said if said.severity <= severity]

    def beat(self, state: int = State.OK, *, mav: Any = None, kind: int = 18, call: int = 7) -> None:
        """A heartbeat arrives, in `policy`, from the companion unless `mav` is another."""
        mode = int(state) | heartbeat_mode(State.STARTING, call, self.policy)
        self.hear(mavlink.MAVLink_heartbeat_message(kind, 8, 0, mode, 4, 3).pack(mav or self.companion))

    def tell(self, text: bytes, severity: int = 3, *, mav: Any = None) -> None:
        """A STATUSTEXT arrives."""
        self.hear(mavlink.MAVLink_statustext_message(severity, text).pack(mav or self.companion))

    def hear(self, datagram: Any) -> None:
        self.scripting.receive(bytes(datagram), 0)

    def pass_time(self, seconds: float, *, state: int | None = None) -> None:
        """Let time pass, with a heartbeat a second where a state is given."""
        for step in range(round(seconds / CYCLE)):
            if state is not None and step % 10 == 0:
                self.beat(state)
            self.scripting.poll()
            self.ms += 100

    def human_sets(self, mode: int, reason: int = BY_GCS) -> None:
        self.mode_now, self.reason = mode, reason

    def _break(self, name: str) -> None:
        if name in self.broken:
            raise RuntimeError(f"{name} is broken")


def driving(start_ms: int = 0, *, policy: Policy = Policy.HOLD, **parameters: float) -> Board:
    """In AUTO, armed, with a companion that is well, which has just been heard."""
    board = Board(start_ms=start_ms, policy=policy, **parameters)
    board.pass_time(3.0, state=State.OK)
    board.beat()
    board.pass_time(CYCLE)
    return board


def until_held(board: Board, limit: float = 20.0) -> float:
    """Seconds until HOLD."""
    begun = board.t
    while board.mode_now != HOLD and board.t - begun < limit:
        board.pass_time(CYCLE)
    return board.t - begun
