"""Lets the simulated autopilot run the script that ships for ArduPilot."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.release import to_install
from anytraverse.resources import resource
from companion.sim.field.modes import Mode
from companion.sim.field.parameters import REAL32
from companion.sim.field.router import Port
from companion.sim.field.scripting import Scripting
from companion.sim.field.telemetry import RC_CHANNELS
from companion.wire.ids import MODE_REQUEST_COMMAND

if TYPE_CHECKING:
    from companion.sim.field.autopilot import SimulatedAutopilot


SCRIPT = "config/ardupilot/anytraverse.lua"
BY_SCRIPT = "script"
COMPANION = Port.COMPANION.value
MAX_TEXT = 50
FEED_TIMEOUT = 0.5
_NO_SENSOR, _NO_DATA, _GOOD = range(3)
# ArduPilot's ModeReason: 1 RC, 2 GCS command, 26 initialised, 32 scripting. It does not tell a companion's
# command from a ground station's.
_REASONS = {"companion": 2, "gcs": 2, "hand": 1, BY_SCRIPT: 32}
_INITIALISED = 26


def install(autopilot: SimulatedAutopilot) -> str:
    """Makes `autopilot` run the shipped script. Returns "", or why it does not run."""
    try:
        source = resource(SCRIPT).read_text(encoding="utf-8")
        steps = int(autopilot.parameters["SCR_VM_I_COUNT"])
        autopilot.script = Scripting(source, "anytraverse.lua", ScriptHost(autopilot), vm_steps=steps)
    except ImportError:
        return f"lupa is missing: {to_install('sim')}"
    except (OSError, ValueError) as reason:
        return str(reason)
    autopilot.parameters.set("SCR_ENABLE", 1)
    return ""


class ScriptHost:
    """Implements `scripting.Host` on a simulated autopilot; its clock is the rover's time."""

    def __init__(self, autopilot: SimulatedAutopilot) -> None:
        self._autopilot = autopilot

    def millis(self) -> int:
        return round(self._autopilot.rover.time * 1000)

    def mode(self) -> int:
        return int(self._autopilot.mode)

    def mode_reason(self) -> int:
        return _REASONS.get(self._autopilot.mode_by, _INITIALISED)

    def set_mode(self, number: int) -> bool:
        if number not in {int(mode) for mode in Mode}:
            return False
        self._autopilot.set_mode(Mode(number), BY_SCRIPT)
        return True

    def is_armed(self) -> bool:
        return self._autopilot.armed

    def speed(self) -> float:
        return abs(self._autopilot.rover.speed)

    def send_text(self, severity: int, text: bytes) -> None:
        self._autopilot.send_text(text[:MAX_TEXT], severity)

    def send_message(self, channel: int, number: int, payload: bytes) -> bool:
        kind = mavlink.mavlink_map.get(number)
        ports = list(Port)
        if kind is None or channel >= len(ports):
            return False
        # The payload is as on the wire: fields in wire order, zeros at the end may be left out.
        full = payload.ljust(kind.unpacker.size, b"\0")
        fields = kind.unpacker.unpack(full[: kind.unpacker.size])
        ordered = {name: fields[place] for name, place in zip(kind.fieldnames, kind.orders, strict=True)}
        self._autopilot.send(ports[channel], kind(**ordered))
        if ordered.get("command") == MODE_REQUEST_COMMAND and ordered["result"] in (
            mavlink.MAV_RESULT_ACCEPTED,
            mavlink.MAV_RESULT_IN_PROGRESS,
        ):
            self._credit_companion()
        return True

    def _credit_companion(self) -> None:
        """Logs a mode that the script has just set at the companion's request as the companion's."""
        log = self._autopilot.mode_log
        if log and log[-1].by == BY_SCRIPT and log[-1].t == self._autopilot.rover.time:
            log[-1] = replace(log[-1], by=COMPANION)

    def parameter(self, name: str) -> float | None:
        row = self._autopilot.parameters.find(name)
        return None if row is None else row.value

    def add_parameter(self, name: str, default: float) -> None:
        self._autopilot.parameters.add(name, REAL32, default)

    def proximity_sensors(self) -> int:
        return int(self._autopilot.parameters["PRX1_TYPE"] > 0)

    def proximity_status(self) -> int:
        if not self.proximity_sensors():
            return _NO_SENSOR
        fed_at, now = self._autopilot.obstacles_at, self._autopilot.rover.time
        return _GOOD if fed_at is not None and now - fed_at <= FEED_TIMEOUT else _NO_DATA

    def switch(self, function: int) -> int | None:
        for channel in range(1, RC_CHANNELS + 1):
            if self.parameter(f"RC{channel}_OPTION") == function:
                pulse = self._autopilot.rover.transmitter.switches.get(channel, 1500)
                return 0 if pulse < 1200 else 2 if pulse > 1800 else 1
        return None
