"""What the companion must know of the vehicle's autopilot; one file a kind, chosen by its heartbeat."""

from __future__ import annotations

from companion.vehicle import ardupilot, px4
from companion.vehicle.autopilot import Autopilot, ModeCommand

__all__ = ["PX4_HOLDS", "Autopilot", "ModeCommand", "known_autopilot"]

_ROVERS = frozenset({10, 11})
"""MAV_TYPE_GROUND_ROVER and MAV_TYPE_SURFACE_BOAT: one number means another mode on a copter."""
PX4_HOLDS = {"loiter": px4.LOITERING, "offboard": px4.OFFBOARD_HOLD}
"""The ways to hold a PX4 rover, by their names in the configuration."""


def known_autopilot(kind: int, vehicle: int, px4_hold: str = "loiter") -> Autopilot | None:
    """The table for HEARTBEAT.autopilot `kind` and HEARTBEAT.type `vehicle`; None: never to be commanded."""
    if vehicle not in _ROVERS:
        return None
    return {ardupilot.MAV_AUTOPILOT: ardupilot.ROVER, px4.MAV_AUTOPILOT: PX4_HOLDS[px4_hold]}.get(kind)
