"""Runs the commands that the autopilot knows, by one table; every other one is answered UNSUPPORTED."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.router import Port
from companion.sim.field.telemetry import Streams

ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
FAILED = int(mavlink.MAV_RESULT_FAILED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
VERSION_4_6_0 = 0x040600FF
NOTHING = bytes(8)
MAV_CMD_SCRIPTING = 42701
SCRIPTING_RESTART = 3

Handler = Callable[[Port, Sequence[float]], int]


class _Script(Protocol):
    """What a command can do to the autopilot's script."""

    blocked: set[int]

    def restart(self) -> None: ...


class Commanded(Protocol):
    """What the commands need of an autopilot."""

    streams: dict[Port, Streams]

    @property
    def script(self) -> _Script | None: ...
    def send(self, port: Port, message: Any) -> None: ...
    def results(self, command: int, result: int, /) -> list[int]: ...
    def find_mode(self, custom: int, sub: int, /) -> Any: ...
    def may_enter(self, mode: Any, /) -> bool: ...
    def set_mode(self, mode: Any, by: str) -> None: ...
    def set_reverse(self, *, on: bool) -> bool: ...
    def set_item(self, number: int) -> bool: ...
    def arm(self, *, on: bool) -> bool: ...
    def message(self, number: int) -> Any: ...


class Commands:
    """Runs COMMAND_LONG and COMMAND_INT for an autopilot and acknowledges each to its sender."""

    def __init__(self, autopilot: Commanded) -> None:
        self._autopilot = autopilot
        self._handlers: dict[int, Handler] = {
            int(mavlink.MAV_CMD_DO_SET_MODE): self.set_mode,
            int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM): self._arm,
            int(mavlink.MAV_CMD_DO_SET_REVERSE): self._set_reverse,
            int(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT): self._set_item,
            int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL): self._set_interval,
            int(mavlink.MAV_CMD_REQUEST_MESSAGE): self._request,
            int(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES): self._capabilities,
            int(mavlink.MAV_CMD_PREFLIGHT_STORAGE): self._store,
            MAV_CMD_SCRIPTING: self._scripting,
        }

    def run(self, port: Port, frame: Any) -> None:
        """Runs the command in `frame` and acknowledges it; NaN where a number is needed is DENIED.

        A command that the script has blocked is the script's to answer.
        """
        script = self._autopilot.script
        if script is not None and frame.command in script.blocked:
            return
        handler = self._handlers.get(frame.command)
        asked = [frame.param1, frame.param2, frame.param3]
        result = UNSUPPORTED if handler is None else handler(port, asked)
        for acknowledged in self._autopilot.results(frame.command, result):
            self.acknowledge(port, frame, frame.command, acknowledged)

    def acknowledge(self, port: Port, frame: Any, command: int, result: int) -> None:
        """Sends COMMAND_ACK to the sender of `frame`."""
        self._autopilot.send(
            port,
            mavlink.MAVLink_command_ack_message(
                command, result, 0, 0, frame.get_srcSystem(), frame.get_srcComponent()
            ),
        )

    def set_mode(self, port: Port, asked: Sequence[float]) -> int:
        """Sets the mode. `asked`: base mode with the custom-mode bit, custom mode and, for PX4, sub mode."""
        base, custom = _whole(asked[0]), _whole(asked[1])
        if base is None or custom is None or not base & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        sub = _whole(asked[2]) if len(asked) > 2 else 0
        mode = self._autopilot.find_mode(custom, sub or 0)
        if mode is None or not self._autopilot.may_enter(mode):
            return FAILED
        self._autopilot.set_mode(mode, by=port.value)
        return ACCEPTED

    def _arm(self, _port: Port, asked: Sequence[float]) -> int:
        if asked[0] not in (0.0, 1.0):
            return DENIED
        return ACCEPTED if self._autopilot.arm(on=asked[0] == 1.0) else FAILED

    def _set_reverse(self, _port: Port, asked: Sequence[float]) -> int:
        if asked[0] not in (0.0, 1.0):
            return DENIED
        return ACCEPTED if self._autopilot.set_reverse(on=asked[0] == 1.0) else UNSUPPORTED

    def _set_item(self, _port: Port, asked: Sequence[float]) -> int:
        number = _whole(asked[0])
        return ACCEPTED if number is not None and self._autopilot.set_item(number) else DENIED

    def _set_interval(self, port: Port, asked: Sequence[float]) -> int:
        number = _whole(asked[0])
        known = number is not None and self._autopilot.streams[port].set_interval(number, asked[1])
        return ACCEPTED if known else FAILED

    def _request(self, port: Port, asked: Sequence[float]) -> int:
        number = _whole(asked[0])
        if number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return self._capabilities(port, asked)
        message = None if number is None else self._autopilot.message(number)
        if message is None:
            return FAILED
        self._autopilot.send(port, message)
        return ACCEPTED

    def _capabilities(self, port: Port, _asked: Sequence[float]) -> int:
        able = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        self._autopilot.send(
            port,
            mavlink.MAVLink_autopilot_version_message(
                able, VERSION_4_6_0, 0, 0, 0, NOTHING, NOTHING, NOTHING, 0, 0, 0
            ),
        )
        return ACCEPTED

    def _scripting(self, _port: Port, asked: Sequence[float]) -> int:
        script = self._autopilot.script
        if script is None or asked[0] != SCRIPTING_RESTART:
            return FAILED
        script.restart()
        return ACCEPTED

    def _store(self, _port: Port, _asked: Sequence[float]) -> int:
        return ACCEPTED


def _whole(value: float) -> int | None:
    return int(value) if math.isfinite(value) else None
