"""Reads the items of a mission. Each value is checked, since the vehicle's way is made of them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, DELAY, LAST_NAVIGATION, JUMP = 16, 17, 19, 93, 95, 177
"""MAV_CMD. Up to `LAST_NAVIGATION` they are those that the vehicle goes to or waits for."""
GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})
"""MAV_FRAME with latitude and longitude."""
MOST_ITEMS = 700
_LATITUDES, _LONGITUDES = 900_000_000, 1_800_000_000
_E7 = 1e7


class MissionItem(NamedTuple):
    """An item of the mission.

    seq: its number, from 0; with ArduPilot item 0 is home. command: MAV_CMD. frame: MAV_FRAME. param1: s of
    delay at a waypoint, and the number of the item that a jump goes to. lat, lon: degrees; 0 where the
    command has none.
    """

    seq: int
    command: int
    frame: int
    param1: float
    lat: float
    lon: float

    @property
    def is_place(self) -> bool:
        """Whether this is a waypoint whose place is known."""
        return self.command == WAYPOINT and self.has_place

    @property
    def is_plain(self) -> bool:
        """Whether this is a waypoint that the vehicle drives through without a stop."""
        return self.is_place and self.param1 == 0.0

    @property
    def has_place(self) -> bool:
        """Whether latitude and longitude are those of a place. 0 means the place where the vehicle is."""
        inside = 0.0 < abs(self.lat) <= 90.0 and 0.0 < abs(self.lon) <= 180.0
        return inside and self.frame in GLOBAL_FRAMES


def read_item(message: Any) -> MissionItem:
    """Read MISSION_ITEM_INT. Raises ValueError that says what is wrong with it, for a person."""
    seq, command = int(message.seq), int(message.command)
    if not math.isfinite(message.param1):
        raise ValueError(f"item {seq} has a parameter that is no number")
    inside = abs(message.x) <= _LATITUDES and abs(message.y) <= _LONGITUDES
    if command == WAYPOINT and not inside:
        raise ValueError(f"item {seq} lies outside the earth")
    lat, lon = (message.x / _E7, message.y / _E7) if inside else (0.0, 0.0)
    return MissionItem(seq, command, int(message.frame), float(message.param1), lat, lon)
