"""Makes the mission's way ahead in the axes of odometry, from its items and the vehicle's newest reports."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from anytraverse.frame import Pose
from companion.guide import legs
from companion.guide.legs import LONGEST, Place
from companion.guide.plan import Route
from companion.vehicle.ardupilot import AUTO, GUIDED, HOLD
from companion.vehicle.mission import MissionItem
from companion.vehicle.motion import MotionReport, pose_at
from companion.vehicle.state import Vehicle

AHEAD = 30.0
"""m of the way ahead that a route has at most."""
OLDEST = 1.5
"""s. An older position says too little of where the vehicle is by odometry."""
MISSION_LASTS = 5.0
"""s after which a report of the mission does not say any more which item is the current one."""
_MOTIONS = 12
"""Reports kept, one every 0.25 s: a position is as old as `OLDEST` at most."""
_ANEW = 500.0
"""m between two poses that only an odometry that began anew has."""
_POINT = 0.01
_DRIVES = frozenset({AUTO, GUIDED, HOLD})
"""Modes in which what was passed stays passed."""


def route(
    items: Sequence[MissionItem],
    current: int,
    position: Place,
    pose: Pose,
    corridor: float,
    began: Place | None = None,
) -> Route | None:
    """Return the way ahead, to the last waypoint that may be passed without AUTO, or `AHEAD` m.

    It begins with the leg to the current item. position, pose: of the same time. began: where the vehicle was
    when that item became the current one, None: where it is now. None where that item is no waypoint, lies at
    the vehicle's own place, or farther away than `LONGEST`.
    """
    to = legs.waypoint(items, current)
    if to is None:
        return None
    places = [legs.start_of(items, current) or began or position, (to.lat, to.lon)]
    points = [legs.offset(position, place) for place in places]
    if not all(math.hypot(*point) <= LONGEST for point in points):  # also where one is not a number
        return None
    ahead = math.hypot(*points[1]) if points[0] == points[1] else _left(points[0], points[1])
    while ahead < AHEAD and legs.may_pass(items, current):
        current += 1
        point = legs.offset(position, (items[current].lat, items[current].lon))
        if not math.hypot(*point) <= LONGEST:
            break
        ahead += math.dist(points[-1], point)
        points.append(point)
    points = _without_repeats(_cut(points, ahead - AHEAD))
    if len(points) < 2 or not all(map(math.isfinite, (*pose, corridor))):
        return None
    return Route(tuple((pose.x + x, pose.y + y) for x, y in points), corridor)


def _left(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return how many m of a line lie beyond the point nearest to the vehicle."""
    return (1.0 - legs.along(start, end)) * math.dist(start, end)


def _cut(points: list[tuple[float, float]], over: float) -> list[tuple[float, float]]:
    """Return the line without the last `over` m of its last piece."""
    last = math.dist(points[-2], points[-1])
    if over <= 0.0 or last <= over:
        return points
    return [*points[:-1], legs.between(points[-2], points[-1], 1.0 - over / last)]


def _without_repeats(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    kept = points[:1]
    for point in points[1:]:
        if math.dist(kept[-1], point) > _POINT:
            kept.append(point)
    return kept


class MissionRoute:
    """Keeps what the way ahead is made of: the items, where the leg began, and the newest position's pose.

    corridor: m to each side, see `Route`. item: the number of the item that is to be driven to: the current
    one, or a later one where the vehicle has passed it (`legs.passed`). why: why there is no route, for a
    person; "" where there is one.
    """

    def __init__(self, corridor: float) -> None:
        self.corridor = corridor
        self.item = 0
        self.why = "no position"
        self._items: tuple[MissionItem, ...] | None = None
        self._current = 0
        self._began: Place | None = None
        self._came = False
        """Whether the vehicle was seen before the current item's waypoint."""
        self._motions: deque[MotionReport] = deque(maxlen=_MOTIONS)
        self._position: Place = (0.0, 0.0)
        self._position_at = -math.inf
        self._pose: Pose | None = None

    @property
    def nears(self) -> float:
        """How many m the waypoint of `item` is away, inf where it may not be passed."""
        items = self._items or ()
        if not legs.may_pass(items, self.item):
            return math.inf
        place = items[self.item]
        return math.hypot(*legs.offset(self._position, (place.lat, place.lon)))

    def update(
        self, vehicle: Vehicle | None, items: tuple[MissionItem, ...] | None, now: float
    ) -> Route | None:
        """Take the newest reports, and return the way ahead from them; None: see `why`.

        Call it for each new report, since it keeps those of the motion. now: s of the link's clock.
        """
        self._note(vehicle)
        if items is not self._items:  # what was passed in another mission is not passed in this one
            self._items, self._began = items, None
        if vehicle is not None and vehicle.mission is not None and vehicle.mission.item != self._current:
            self._current, self._began = vehicle.mission.item, None
        if vehicle is not None and vehicle.custom_mode not in _DRIVES:  # a human may drive it back
            self._began = None
        if self._began is None:
            self.item = self._current
        self.why = self._missing(vehicle, items, now)
        if self.why or vehicle is None or vehicle.mission is None or not items or self._pose is None:
            return None
        if self._began is None:
            self._began, self._came = self._position, False
        # Whoever sends the vehicle back to a waypoint wants it to go there, so it must come from before it.
        if legs.may_pass(items, self.item) and not self._came:
            self._came = not legs.is_beyond(items, self.item, self._position, self._began)
        # A waypoint stays passed until another item is the current one, however far the way winds on.
        if self._came:
            self.item = legs.passed(items, self.item, self._position, self.corridor, self._began)
        found = route(items, self.item, self._position, self._pose, self.corridor, self._began)
        if found is None:
            self.why = "the current item is no waypoint, or too far away"
        return found

    def _note(self, vehicle: Vehicle | None) -> None:
        """Take the newest motion and position. The pose is that at the time of the position."""
        if vehicle is None or vehicle.motion is None or vehicle.motion.pose is None:
            self._pose = None
            return
        last = self._motions[-1] if self._motions else None
        if last is None or vehicle.motion.at > last.at:
            before = last.pose if last is not None else None
            if before is not None and math.dist(before[:2], vehicle.motion.pose[:2]) > _ANEW:
                self._motions.clear()
                self._pose = None
            self._motions.append(vehicle.motion)
        if vehicle.position is None or vehicle.position_at is None:
            return
        if vehicle.position_at != self._position_at or self._pose is None:
            pose = pose_at(self._motions, vehicle.position_at)
            if pose is not None:
                self._position, self._position_at = vehicle.position[:2], vehicle.position_at
                self._pose = pose

    def _missing(self, vehicle: Vehicle | None, items: tuple[MissionItem, ...] | None, now: float) -> str:
        """Name what is not known, "" for nothing."""
        if not items:
            return "the mission's items are not known"
        if vehicle is None or vehicle.mission is None or now - vehicle.mission.at > MISSION_LASTS:
            return "the current item is not known"
        if vehicle.position is None or now - (vehicle.position_at or -math.inf) > OLDEST:
            return "no position"
        if self._pose is None or now - self._position_at > OLDEST:
            return "no odometry"
        return ""
