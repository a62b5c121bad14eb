"""Describes ArduPilot Rover: its modes, and the texts of the script on the autopilot."""

from __future__ import annotations

import re
from typing import NamedTuple

from companion.vehicle.autopilot import Autopilot, ModeCommand

MAV_AUTOPILOT = 3
AUTO, GUIDED, HOLD, INITIALISING = 10, 15, 4, 16
_RTL, _SMART_RTL = 11, 12
_CUSTOM = 1
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""
LONGEST_BRAKE = 4.0
"""Seconds after which the script ends its braking in HOLD at the latest."""


class ScriptHold(NamedTuple):
    """A hold by the script that runs on the autopilot.

    why: what it holds for. mode: the mode that a human must set to drive on.
    """

    why: str
    mode: str


_SCRIPT_HOLD = re.compile(r"HOLD(?:: | since )([a-z ]{1,20})(?:\. |: set )([A-Z]{3,8}) ")


def script_hold(text: str) -> ScriptHold | None:
    """Parse a STATUSTEXT of the autopilot. None: it does not report a hold by the script."""
    found = _SCRIPT_HOLD.match(text)
    return ScriptHold(*found.groups()) if found is not None else None


def _command(mode: int) -> ModeCommand:
    return _CUSTOM, mode, 0


ROVER = Autopilot(
    name="ArduPilot",
    holdable=frozenset({AUTO, GUIDED}),
    hold_mode=HOLD,
    rest_mode=HOLD,
    command=_command,
    mission_modes=frozenset({AUTO}),
    brake_mode=GUIDED,
    first_item=1,
    loses_target=frozenset({GUIDED}),
    booting=frozenset({INITIALISING}),
    scripted=True,
    by_itself=frozenset({_RTL, _SMART_RTL}),
    names={
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
        _RTL: "RTL",
        _SMART_RTL: "SMART_RTL",
        GUIDED: "GUIDED",
        INITIALISING: "INITIALISING",
    },
)
