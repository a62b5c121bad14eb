"""Finds the mission's legs: where each begins, where it leads, and when it has been driven. Pure.

Places are (latitude, longitude) in degrees. The earth is flat about the place where the vehicle is: a leg is
at most `LONGEST` long, and lies less than 0.2 m aside from the true one up to 60 degrees of latitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.vehicle.mission import (
    DELAY,
    JUMP,
    LAST_NAVIGATION,
    LOITER_TIME,
    LOITER_UNLIMITED,
    MissionItem,
)
from companion.vehicle.state import METRES_PER_DEGREE

Place = tuple[float, float]
LONGEST = 2000.0
"""m from the vehicle to any end of a leg."""
SLACK = 2.0
"""m beyond the corridor within which a waypoint counts as passed."""
_POINT = 0.01
"""m. A shorter leg has no direction."""
_STAYS = frozenset({LOITER_UNLIMITED, LOITER_TIME})


def offset(origin: Place, place: Place) -> tuple[float, float]:
    """Return how far `place` lies to the north and to the WEST of `origin`, in m."""
    north = (place[0] - origin[0]) * METRES_PER_DEGREE
    east = math.remainder(place[1] - origin[1], 360.0) * METRES_PER_DEGREE
    return north, -east * math.cos(math.radians(origin[0]))


def waypoint(items: Sequence[MissionItem], item: int) -> MissionItem | None:
    """Return the item of this number where it is a waypoint. Item 0 is home, and none."""
    known = 0 < item < len(items) and items[item].is_place
    return items[item] if known else None


def start_of(items: Sequence[MissionItem], current: int) -> Place | None:
    """Return the place of the item that is driven to before the current one.

    None where that is not known: at the first item, and at one that a jump leads to.
    """
    targets = {round(one.param1) for one in items if one.command == JUMP}
    for number in range(current, 1, -1):
        before = items[number - 1]
        if number in targets:
            return None
        if before.is_place or (before.command in _STAYS and before.has_place):
            return before.lat, before.lon
        if before.command <= LAST_NAVIGATION and before.command != DELAY:
            return None
    return None


def may_pass(items: Sequence[MissionItem], item: int) -> bool:
    """Whether the vehicle may pass the item's waypoint without AUTO: it is plain, and so is the next one."""
    pair = items[item : item + 2] if item > 0 else ()
    return len(pair) == 2 and all(one.is_plain for one in pair)


def passed(items: Sequence[MissionItem], current: int, position: Place, corridor: float, began: Place) -> int:
    """Return the number of the item that the vehicle has to drive to, `current` or a later one.

    A waypoint is passed where the vehicle is beyond the plane through it that halves the angle between its
    two legs, and within `corridor` m and `SLACK` of the next one. Where the way turns back by more than 90
    degrees, the plane is square to the first leg: the vehicle must have driven that to its end.
    """
    while may_pass(items, current):
        there = offset(position, (items[current + 1].lat, items[current + 1].lon))
        here = offset(position, (items[current].lat, items[current].lon))
        if not is_beyond(items, current, position, began) or away(here, there) > corridor + SLACK:
            break
        current += 1
    return current


def is_beyond(items: Sequence[MissionItem], item: int, position: Place, began: Place) -> bool:
    """Whether the vehicle is beyond the plane through a waypoint that `may_pass`, see `passed`."""
    came = offset(position, start_of(items, item) or began)
    here, there = (offset(position, (one.lat, one.lon)) for one in items[item : item + 2])
    first, second = _direction(came, here), _direction(here, there)
    first, second = first or second, second or first
    if first is None or second is None:
        return False
    ahead = first[0] * second[0] + first[1] * second[1] >= 0.0
    plane = (first[0] + second[0], first[1] + second[1]) if ahead else first
    return plane[0] * here[0] + plane[1] * here[1] < 0.0


def away(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the distance of (0, 0) from the line from start to end, in m."""
    return math.hypot(*between(start, end, along(start, end)))


def along(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return which part of the line from start to end lies before the point nearest to (0, 0): [0, 1]."""
    x, y = end[0] - start[0], end[1] - start[1]
    squared = x * x + y * y
    if squared < _POINT * _POINT:
        return 0.0
    return min(1.0, max(0.0, -(start[0] * x + start[1] * y) / squared))


def between(start: tuple[float, float], end: tuple[float, float], part: float) -> tuple[float, float]:
    """Return the point that lies so far on the way from start, at 0, to end, at 1."""
    return start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])


def _direction(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float] | None:
    x, y = end[0] - start[0], end[1] - start[1]
    length = math.hypot(x, y)
    return (x / length, y / length) if length > _POINT else None
