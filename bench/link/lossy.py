"""Makes calls over a bad radio in virtual time: each must be answered exactly once."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from bench.link.drive import DriveOutcome, drive
from bench.link.operator import Operator
from bench.link.radio_model import LinkConditions, RadioModel
from bench.link.rover import Rover
from bench.virtual_time import Clock, virtual_time
from companion.sim.loopback_link import pair
from companion.wire.ids import AUTOPILOT_COMPONENT_ID

LINK_CONDITIONS = {
    "clear": LinkConditions(),
    "loss 10 %": LinkConditions(loss=0.1),
    "loss 30 %": LinkConditions(loss=0.3),
    "loss 50 %": LinkConditions(loss=0.5),
    "duplicates": LinkConditions(twice=0.3),
    "reordering": LinkConditions(shuffled=0.3),
    "stalls of 1 s": LinkConditions(stall_every=4.0),
    "1 kB/s": LinkConditions(rate=1000.0),
    "all of it": LinkConditions(loss=0.3, twice=0.2, shuffled=0.2, stall_every=8.0, rate=1000.0),
}
"""The kinds of bad radio; each acts in both directions."""
STEP = 0.02
_COMMAND_LONG = 76


class StreamingAutopilot:
    """An ArduPilot rover in AUTO: it sends heartbeats, and streams what is requested."""

    def __init__(self) -> None:
        self._mavlink = mavlink.MAVLink(None, 1, AUTOPILOT_COMPONENT_ID)
        self._says_at = 0.0

    def says(self, now: float) -> list[bytes]:
        """Returns heartbeat, position, attitude and time, once a second."""
        if now < self._says_at:
            return []
        self._says_at = now + 1.0
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        uptime = int(1000 * now) & 0xFFFFFFFF
        return [
            self._packed(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, flags, 10, 4, 3
                )
            ),
            self._packed(mavlink.MAVLink_global_position_int_message(uptime, 1, 1, 1, 1, 0, 0, 0, 9000)),
            self._packed(mavlink.MAVLink_attitude_message(uptime, 0, 0, 0, 0, 0, 0)),
            self._packed(mavlink.MAVLink_system_time_message(1_790_000_000_000_000, uptime)),
        ]

    def _packed(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame


def is_for_autopilot(frame: bytes) -> bool:
    """Whether a frame is a command to the autopilot; all other frames are for the ground."""
    return int.from_bytes(frame[7:10], "little") == _COMMAND_LONG


class Radio:
    """The bad radio: the rover's only wire, and the connection of the operator's client."""

    name = "radio"
    trouble = ""

    def __init__(self, weather: LinkConditions, seed: str) -> None:
        self.near, self._far = pair()
        self.up, self.down = RadioModel(weather, f"up {seed}"), RadioModel(weather, f"down {seed}")
        self._autopilot = StreamingAutopilot()

    def carry(self, now: float) -> None:
        """Carries frames between rover, radio and autopilot; between rover and autopilot none is lost."""
        while frame := self._far.read():
            if not is_for_autopilot(frame):
                self.up.put(frame, now)
        for frame in (*self.down.take(now), *self._autopilot.says(now)):
            self._far.write(frame)

    def read(self) -> bytes:
        """Returns what has reached the operator."""
        return b"".join(self.up.take(time.monotonic()))

    def write(self, frame: bytes) -> None:
        """Sends to the rover."""
        self.down.put(frame, time.monotonic())

    def fileno(self) -> int | None:
        """Returns None: there is no file descriptor."""
        return None

    def close(self) -> None:
        """Does nothing: there is nothing to release."""


def drive_in_virtual_time(
    clock: Clock, radio: Radio, rover: Rover, operator: Operator, calls: int, step_s: float = STEP
) -> DriveOutcome:
    """Makes `calls` calls, `step_s` s from one turn of the daemon to the next, and closes the rover."""

    def step() -> None:
        clock.now += step_s
        radio.carry(clock.now)
        rover.turn()
        radio.carry(clock.now)
        operator.step(clock.now)

    try:
        return drive(rover, operator, calls, step)
    finally:
        rover.close()


def run(
    weather: LinkConditions, calls: int, folder: Path, seed: str = "1", step_s: float = STEP
) -> DriveOutcome:
    """Makes `calls` calls in virtual time, `step_s` s from one turn of the daemon to the next."""
    with virtual_time() as clock:
        radio = Radio(weather, seed)
        rover = Rover(folder, lambda: radio.near)
        operator = Operator(radio, seed, lambda: rover.shows)
        return drive_in_virtual_time(clock, radio, rover, operator, calls, step_s)
