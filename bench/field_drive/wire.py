"""Stands in for the link, as the service that guides uses it: nothing is packed, nothing is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from bench.field_drive.autopilot import APART, ScriptedAutopilot
from companion.calls.decisions import SetMode
from companion.sim.field.telemetry import degrees_e7
from companion.sim.field.trail import Trail
from companion.vehicle.mission import WAYPOINT, MissionItem
from companion.vehicle.motion import MotionReport
from companion.vehicle.state import Vehicle

_FRAME = 6
"""MAV_FRAME_GLOBAL_RELATIVE_ALT_INT."""
_ROVER_TYPE = 10
BEYOND = 12.0
"""m by which the mission goes on beyond the route."""


def waypoints(trail: Trail, begin: float, metres: float) -> tuple[MissionItem, ...]:
    """Return home, and the mission's waypoints along the trail."""
    found = []
    for number in range(math.ceil((metres + BEYOND) / APART) + 1):
        at = trail.pose(begin + APART * number)
        latitude, longitude = degrees_e7(at.x, at.y)
        found.append(MissionItem(number, WAYPOINT, _FRAME, 0.0, latitude / 1e7, longitude / 1e7))
    return tuple(found)


@dataclass
class _Items:
    items: tuple[MissionItem, ...]
    wanted: bool = False


@dataclass
class _Setpoints:
    target: tuple[float, float] | None = None


class _Texts:
    def send(self, *_args: Any, **_options: Any) -> None:
        """Nobody reads them."""


class _Modes:
    compares = True

    def __init__(self, autopilot: ScriptedAutopilot) -> None:
        self._autopilot = autopilot

    def guide(self, mode: int, expected: int, _now: float) -> None:
        self._autopilot.request(SetMode(mode, expected), guide=True)


class WireStandIn:
    """Has those parts of `Link` that guiding uses. quick: attitude and position come more often."""

    def __init__(self, autopilot: ScriptedAutopilot, items: tuple[MissionItem, ...]) -> None:
        self.vehicle: Vehicle | None = None
        self.mission, self.setpoints, self.texts = _Items(items), _Setpoints(), _Texts()
        self.modes = _Modes(autopilot)
        self.quick = False
        self._autopilot = autopilot

    def set_current_item(self, item: int, _now: float) -> None:
        """As of `Link`; it is set at once."""
        self._autopilot.item = item

    def request_quick_motion(self, *, quick: bool) -> None:
        """As of `Link`."""
        self.quick = quick

    def heard(self, motion: MotionReport | None, now: float) -> None:
        """Take in what the autopilot reports with this motion."""
        rover = self._autopilot.rover
        latitude, longitude = degrees_e7(rover.x, rover.y)
        compass = (90.0 - math.degrees(rover.heading)) % 360.0
        self.vehicle = Vehicle(
            1,
            3,
            self._autopilot.mode,
            armed=True,
            heard_at=now,
            position=(latitude / 1e7, longitude / 1e7, compass),
            speed=abs(rover.speed),
            position_at=now,
            type=_ROVER_TYPE,
            motion=motion,
            mission=self._autopilot.mission(now),
            course=compass,
        )
