"""Selects the table of an autopilot's modes by its heartbeat. There is one file a kind of autopilot."""

from __future__ import annotations

from companion.vehicle import ardupilot, px4
from companion.vehicle.autopilot import Autopilot, ModeCommand

__all__ = ["PX4_HOLDS", "Autopilot", "ModeCommand", "known_autopilot"]

_ROVERS = frozenset({10, 11})
"""MAV_TYPE_GROUND_ROVER and MAV_TYPE_SURFACE_BOAT. On a copter the same number means another mode."""
PX4_HOLDS = {"loiter": px4.LOITERING, "offboard": px4.OFFBOARD_HOLD}
"""The ways to hold a PX4 rover: value of [call] px4_hold -> table."""


def known_autopilot(kind: int, vehicle: int, px4_hold: str = "loiter") -> Autopilot | None:
    """Return the table for HEARTBEAT.autopilot `kind` and HEARTBEAT.type `vehicle`.

    None: the vehicle is not supported, and must never be commanded.
    """
    if vehicle not in _ROVERS:
        return None
    return {ardupilot.MAV_AUTOPILOT: ardupilot.ROVER, px4.MAV_AUTOPILOT: PX4_HOLDS[px4_hold]}.get(kind)
