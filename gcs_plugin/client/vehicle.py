"""Reads an autopilot's heartbeat: its mode by name, and whether it is armed."""

from __future__ import annotations

from dataclasses import dataclass

ARMED = 0x80
ARDUPILOT = 3
PX4 = 12

_ARDUPILOT_ROVER = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}
_PX4_MAIN = {1: "MANUAL", 2: "ALTITUDE", 3: "POSITION", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
_PX4_AUTO = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND"}


@dataclass(frozen=True)
class TrackedVehicle:
    """Holds the vehicle's mode by name (`MODE 99` for an unknown one) and whether it is armed."""

    mode: str
    armed: bool

    @property
    def text(self) -> str:
        """Mode and arming for a person, e.g. `AUTO armed`."""
        return f"{self.mode} {'armed' if self.armed else 'disarmed'}"


@dataclass(frozen=True)
class Position:
    """Where the vehicle is: degrees. heading: clockwise from north, None where it is not known."""

    latitude: float
    longitude: float
    heading: float | None


def read_position(latitude: int, longitude: int, heading: int) -> Position | None:
    """Read the fields of GLOBAL_POSITION_INT; None for what is none, and for 0, 0, which means no fix."""
    if not (abs(latitude) <= 900_000_000 and abs(longitude) <= 1_800_000_000 and (latitude or longitude)):
        return None
    return Position(latitude / 1e7, longitude / 1e7, heading / 100.0 if heading < 36_000 else None)


def mode_name(autopilot: int, custom_mode: int) -> str:
    """Return the name of `custom_mode` of an ArduPilot rover or a PX4 vehicle."""
    if autopilot == ARDUPILOT:
        return _ARDUPILOT_ROVER.get(custom_mode, f"MODE {custom_mode}")
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if main == 4:
            return f"AUTO.{_PX4_AUTO.get(sub, sub)}"
        return _PX4_MAIN.get(main, f"MODE {main}.{sub}")
    return f"MODE {custom_mode}"


def read_vehicle(autopilot: int, base_mode: int, custom_mode: int) -> TrackedVehicle:
    """Read mode and arming from the fields of component 1's HEARTBEAT."""
    return TrackedVehicle(mode_name(autopilot, custom_mode), bool(base_mode & ARMED))
