"""Describes the PX4 rover and the two ways to hold it.

LOITERING needs no setpoints, but an Ackermann rover does not stop straight in it: it drives some metres on,
turns and drives back to the point. OFFBOARD_HOLD brakes on the spot, but only while zero-velocity setpoints
are streamed. Without them PX4's offboard-loss fail-safe acts, which may be to drive home.
"""

from __future__ import annotations

from dataclasses import replace

from companion.vehicle.autopilot import Autopilot, ModeCommand

MAV_AUTOPILOT = 12
_CUSTOM = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
_AUTO = 4
"""PX4_CUSTOM_MAIN_MODE_AUTO."""


def custom_mode(main: int, sub: int = 0) -> int:
    """Return the HEARTBEAT.custom_mode of a PX4 main mode and sub mode."""
    return main << 16 | sub << 24


def _command(mode: int) -> ModeCommand:
    return _CUSTOM, mode >> 16 & 0xFF, mode >> 24 & 0xFF


MISSION = custom_mode(_AUTO, 4)
LOITER = custom_mode(_AUTO, 3)
OFFBOARD = custom_mode(6)
_RTL, _LAND = custom_mode(_AUTO, 5), custom_mode(_AUTO, 6)

LOITERING = Autopilot(
    name="PX4",
    holdable=frozenset({MISSION}),
    hold_mode=LOITER,
    rest_mode=LOITER,
    command=_command,
    mission_modes=frozenset({MISSION}),
    streamed=frozenset({OFFBOARD}),
    by_itself=frozenset({_RTL, _LAND}),
    lead=0.7,
    reports_mode_late=True,
    contradicts_itself=True,
    stops_without_sticks=True,
    overrun=2.5,
    names={
        custom_mode(1): "MANUAL",
        custom_mode(2): "ALTITUDE",
        custom_mode(3): "POSITION",
        custom_mode(5): "ACRO",
        OFFBOARD: "OFFBOARD",
        custom_mode(7): "STABILIZED",
        custom_mode(_AUTO, 1): "READY",
        custom_mode(_AUTO, 2): "TAKEOFF",
        LOITER: "LOITER",
        MISSION: "MISSION",
        _RTL: "RTL",
        _LAND: "LAND",
    },
)
OFFBOARD_HOLD = replace(LOITERING, hold_mode=OFFBOARD, overrun=0.0)
