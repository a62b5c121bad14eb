"""What the companion must know of ArduPilot Rover: its modes, and how to ask for one.

PX4 gets its own table here.
"""

from __future__ import annotations

ARDUPILOT = 3
"""MAV_AUTOPILOT_ARDUPILOTMEGA."""

AUTO = 10
GUIDED = 15
HOLD = 4
HOLDABLE = frozenset({AUTO, GUIDED})
"""Modes in which the autopilot drives by itself; only out of these may the companion hold."""

_NAMES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    HOLD: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    AUTO: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    GUIDED: "GUIDED",
    16: "INITIALISING",
}


def mode_name(custom_mode: int) -> str:
    """ "AUTO"; "mode 99" for one that this table does not know."""
    return _NAMES.get(custom_mode, f"mode {custom_mode}")


def may_hold(autopilot: int, custom_mode: int, *, armed: bool) -> bool:
    """Whether the vehicle drives by itself, so that a hold takes it from nobody."""
    return autopilot == ARDUPILOT and armed and custom_mode in HOLDABLE
