"""Plays a person at a ground station, who answers calls and sets how fast the rover drives."""

from __future__ import annotations

import socket
import time
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.field.modes import Mode
from companion.sim.field.router import DatagramParser
from companion.wire.ids import ANSWER_COMMAND, COMPONENT_ID, Motion

ROVER, AUTOPILOT = 1, 1
GROUND = 255, 190
REAL32 = 9


class SecondPort:
    """Sends to the autopilot's second port; only `press` reads what comes back."""

    def __init__(self, url: str) -> None:
        """url: as the field prints it, udpout:HOST:PORT."""
        _, host, port = url.split(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((host, int(port)))
        self._mav = mavlink.MAVLink(None, *GROUND)

    def close(self) -> None:
        self._socket.close()

    def set_speed(self, speed: float) -> None:
        """Sets the speed along the trail, m/s."""
        self.set_of_autopilot("CRUISE_SPEED", speed)

    def set_of_autopilot(self, name: str, value: float) -> None:
        """Sets one of the autopilot's parameters."""
        self._send(mavlink.MAVLink_param_set_message(ROVER, AUTOPILOT, name.encode(), value, REAL32))

    def set_parameter(self, name: str, value: float) -> None:
        """Sets one of the companion's parameters."""
        self._send(mavlink.MAVLink_param_set_message(ROVER, COMPONENT_ID, name.encode(), value, REAL32))

    def set_weight(self, word: str, weight: float) -> None:
        """Sets the weight of one of the companion's words."""
        self.set_parameter(f"AT_W_{word}", weight)

    def reverse(self, *, on: bool) -> None:
        """Makes the rover's mission drive backwards, or forwards again."""
        params = (float(on), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        command = int(mavlink.MAV_CMD_DO_SET_REVERSE)
        self._send(mavlink.MAVLink_command_long_message(ROVER, AUTOPILOT, command, 0, *params))

    def go(self, number: int) -> None:
        """Answers go to the call or hold of this id."""
        params = (float(number), float(Motion.GO), 0.0, 0.0, 0.0, 0.0, 0.0)
        self._send(mavlink.MAVLink_command_long_message(ROVER, COMPONENT_ID, ANSWER_COMMAND, 0, *params))

    def target(self) -> None:
        """Sends a target that an autopilot in GUIDED would follow."""
        self._send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, ROVER, AUTOPILOT, mavlink.MAV_FRAME_LOCAL_NED, 0xDC7, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
            )
        )

    def press(self, mode: str, within: float = 1.0) -> None:
        """Commands a mode, and waits until the autopilot has acknowledged that; for a new connection only.

        Raises TimeoutError after `within` s.
        """
        base = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        params = (base, float(Mode[mode]), 0.0, 0.0, 0.0, 0.0, 0.0)
        command = int(mavlink.MAV_CMD_DO_SET_MODE)
        self._send(mavlink.MAVLink_command_long_message(ROVER, AUTOPILOT, command, 0, *params))
        until = time.monotonic() + within
        while (left := until - time.monotonic()) > 0.0:
            self._socket.settimeout(left)
            for frame in DatagramParser().frames(self._socket.recv(65536)):
                if frame.get_type() == "COMMAND_ACK" and frame.command == command:
                    return
        raise TimeoutError(f"the autopilot does not acknowledge {mode}")

    def _send(self, message: Any) -> None:
        self._socket.send(bytes(message.pack(self._mav)))
        self._mav.seq = (self._mav.seq + 1) % 256
