"""PX4 rover, and its two ways to hold.

LOITERING needs nothing of us once it is taken, but an Ackermann rover does not stop straight: it runs some
metres on, turns and drives back to the point. OFFBOARD_HOLD brakes on the spot, but only for as long as zero
velocity is streamed: without it PX4's loss of offboard control acts, which may be to drive home.
"""

from __future__ import annotations

from dataclasses import replace

from companion.vehicle.autopilot import Autopilot, ModeCommand

MAV_AUTOPILOT = 12
_CUSTOM = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
_AUTO = 4


def custom_mode(main: int, sub: int = 0) -> int:
    """HEARTBEAT.custom_mode of a main and a sub mode."""
    return main << 16 | sub << 24


def _command(mode: int) -> ModeCommand:
    return _CUSTOM, mode >> 16 & 0xFF, mode >> 24 & 0xFF


MISSION = custom_mode(_AUTO, 4)
LOITER = custom_mode(_AUTO, 3)
OFFBOARD = custom_mode(6)

LOITERING = Autopilot(
    name="PX4",
    holdable=frozenset({MISSION}),
    hold_mode=LOITER,
    rest_mode=LOITER,
    command=_command,
    streamed=frozenset({OFFBOARD}),
    lead=0.7,
    tells_late=True,
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
        custom_mode(_AUTO, 5): "RTL",
        custom_mode(_AUTO, 6): "LAND",
    },
)
OFFBOARD_HOLD = replace(LOITERING, hold_mode=OFFBOARD, overrun=0.0)
