"""Stores the autopilot's parameters: an ordered table with ArduPilot Rover's names, to which a script adds.

Values travel as floats whatever their type, as ArduPilot sends them. Most of them can only be read and set;
WP_SPEED, CRUISE_SPEED and MIS_RESTART change how the rover drives, ARMING_REQUIRE and INITIAL_MODE how it
boots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import development as mavlink

INT8 = int(mavlink.MAV_PARAM_TYPE_INT8)
INT16 = int(mavlink.MAV_PARAM_TYPE_INT16)
INT32 = int(mavlink.MAV_PARAM_TYPE_INT32)
REAL32 = int(mavlink.MAV_PARAM_TYPE_REAL32)


@dataclass(frozen=True)
class SimulatedParameter:
    """One parameter: position in the list, MAVLink type, value and the range of values that it takes."""

    name: str
    index: int
    kind: int
    value: float
    low: float
    high: float


Row = tuple[str, int, float, float, float]
"""Name, MAV_PARAM_TYPE, default, lowest and highest value."""

ARDUPILOT: tuple[Row, ...] = (
    ("SYSID_THISMAV", INT16, 1, 1, 255),
    ("SYSID_MYGCS", INT16, 255, 1, 255),
    ("FRAME_CLASS", INT8, 1, 0, 3),
    ("ARMING_CHECK", INT32, 0, 0, 1 << 20),
    ("ARMING_REQUIRE", INT8, 1, 0, 4),
    ("INITIAL_MODE", INT8, 4, 0, 15),
    ("MODE_CH", INT8, 8, 0, 16),
    ("CRUISE_SPEED", REAL32, 2.5, 0.0, 5.0),
    ("CRUISE_THROTTLE", INT8, 50, 5, 100),
    ("WP_SPEED", REAL32, 0.0, 0.0, 5.0),
    ("WP_RADIUS", REAL32, 2.0, 0.1, 100.0),
    ("MAV1_POSITION", INT16, 4, 0, 50),
    ("MAV2_POSITION", INT16, 4, 0, 50),
    ("MIS_RESTART", INT8, 0, 0, 1),
    ("MIS_TOTAL", INT16, 6, 0, 32766),
    ("ATC_ACCEL_MAX", REAL32, 1.0, 0.0, 10.0),
    ("ATC_DECEL_MAX", REAL32, 1.4, 0.0, 10.0),
    ("ATC_BRAKE", INT8, 1, 0, 1),
    ("MOT_SLEWRATE", INT16, 100, 0, 1000),
    ("TURN_RADIUS", REAL32, 0.9, 0.0, 10.0),
    ("AVOID_ENABLE", INT8, 3, 0, 7),
    ("AVOID_MARGIN", REAL32, 2.0, 0.1, 10.0),
    ("AVOID_BACKUP_SPD", REAL32, 0.0, 0.0, 2.0),
    ("FS_ACTION", INT8, 2, 0, 5),
    ("FS_THR_ENABLE", INT8, 1, 0, 2),
    ("FS_GCS_ENABLE", INT8, 0, 0, 2),
    ("FS_GCS_TIMEOUT", REAL32, 5.0, 2.0, 120.0),
    ("FS_TIMEOUT", REAL32, 1.5, 1.0, 100.0),
    ("PRX1_TYPE", INT8, 0, 0, 17),
    ("OA_TYPE", INT8, 0, 0, 3),
    ("RC7_OPTION", INT16, 0, 0, 400),
    ("RC8_OPTION", INT16, 0, 0, 400),
    ("SCR_ENABLE", INT8, 0, 0, 1),
    ("SCR_HEAP_SIZE", INT32, 122_880, 1024, 1 << 20),
    ("SCR_VM_I_COUNT", INT32, 10_000, 1000, 1_000_000),
)


class Parameters:
    """Reads parameters by name or index and sets them; a value out of range leaves the old one in force."""

    def __init__(self, table: Sequence[Row] = ARDUPILOT) -> None:
        self._rows = [
            SimulatedParameter(name, i, kind, float(v), low, high)
            for i, (name, kind, v, low, high) in enumerate(table)
        ]
        self._index = {row.name: row.index for row in self._rows}

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, name: str) -> float:
        return self._rows[self._index[name]].value

    def rows(self) -> tuple[SimulatedParameter, ...]:
        return tuple(self._rows)

    def find(self, name: str, index: int = -1) -> SimulatedParameter | None:
        """Finds a parameter by index when that is >= 0, else by name; None when there is none."""
        at = self._index.get(name, -1) if index < 0 else index
        return self._rows[at] if 0 <= at < len(self._rows) else None

    def add(self, name: str, kind: int, default: float) -> None:
        """Adds a parameter at the end. One that exists keeps its value, as a stored one does on ArduPilot."""
        if name not in self._index:
            limit = float(1 << 24)
            self._index[name] = len(self._rows)
            self._rows.append(SimulatedParameter(name, len(self._rows), kind, default, -limit, limit))

    def set(self, name: str, value: float) -> SimulatedParameter | None:
        """Sets a value and returns the row, which is unchanged when `value` is not finite or out of range.

        Returns None when there is no such parameter.
        """
        row = self.find(name)
        if row is None or not math.isfinite(value) or not row.low <= value <= row.high:
            return row
        if row.kind != REAL32:
            value = float(round(value))
        changed = SimulatedParameter(row.name, row.index, row.kind, float(value), row.low, row.high)
        self._rows[row.index] = changed
        return changed
