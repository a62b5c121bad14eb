"""Holds the autopilot's newest report: mode, mission, place, motion, the time. Measures the way driven."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from anytraverse.history import Place
from companion.vehicle.motion import MotionReport
from companion.wire.json_values import place_attributes

METRES_PER_DEGREE = 111_320.0
"""Of latitude, on a sphere."""
_JUMP = 20.0
"""Metres. A longer step between two positions is a new fix and no driving; it is not counted."""
_JITTER = 0.3
"""Metres. A shorter step may be noise; it counts once the vehicle is this far from the last counted point."""


class MissionState(IntEnum):
    """MAVLink's MISSION_STATE."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True)
class Mission:
    """The newest report of the mission. Items are numbered as the autopilot numbers them.

    item: the current one. total: how many there are, None where that is not reported. id: of the mission's
    content, 0 where that is not reported. at: when it was reported, seconds of the link's monotonic clock.
    fresh: it was reported in the last 5 s, and since the autopilot entered its mode.
    reached: the item that was reached last in this mode, None for none. reached_at: when.
    """

    item: int
    total: int | None
    state: MissionState
    id: int
    at: float
    fresh: bool = True
    reached: int | None = None
    reached_at: float = 0.0

    def at_last(self, first: int) -> bool:
        """Whether the last item was reached, or the current one is past the end. first: the first's number.

        Where it is not reported how many there are: the item that was reached has stayed the current one.
        """
        if self.total is None:
            return self.reached == self.item and self.at > self.reached_at
        last = self.total - 1 + first
        return self.item > last or (self.reached is not None and self.reached >= last)

    def replaces(self, other: Mission) -> bool:
        """Whether this is another mission than `other`, as far as the autopilot reports that."""
        return (self.total, self.id) != (other.total, other.id)


@dataclass(frozen=True)
class Vehicle:
    """The newest report of the autopilot. Times that end in `_at` are seconds of the link's monotonic clock.

    autopilot: MAV_AUTOPILOT. type: MAV_TYPE. heard_at: time of its last heartbeat. mode_at: time of its last
    CURRENT_MODE.
    position: (latitude, longitude, heading or None) in degrees; None without a fix or when older than 5 s.
    speed: over ground, m/s; known with the position. course: direction of that speed, degrees clockwise from
    north; None at a speed of 0. attitude: roll, pitch, yaw in degrees; None when older than 5 s. motion: how
    it leans and moves, of the same report.
    clock: the autopilot's time at second 0 of the link's clock, in seconds since 1970; None where it has no
    time.
    reboots: how often its time since boot has run backwards.
    mission: its newest report, None before the first.
    pushes_since: since when it has had a throttle of `PUSHES` or more, seconds of the link's clock; None
    where it has less, or where that is not known. throttle_at: when that was reported.
    """

    system_id: int
    autopilot: int
    custom_mode: int
    armed: bool
    heard_at: float
    position: tuple[float, float, float | None] | None = None
    speed: float | None = None
    position_at: float | None = None
    type: int = 0
    mode_at: float | None = None
    attitude: tuple[float, float, float] | None = None
    attitude_at: float | None = None
    motion: MotionReport | None = None
    clock: float | None = None
    clock_at: float | None = None
    reboots: int = 0
    mission: Mission | None = None
    course: float | None = None
    pushes_since: float | None = None
    throttle_at: float | None = None


PUSHES = 10
"""Percent of throttle from which a vehicle does not stand because it wants to."""
PUSHES_FOR = 1.0
"""s of such a throttle after which a vehicle moves, whatever its speed is reported to be."""
MOVES = 0.2
"""m/s above which a vehicle counts as moving: its camera's image then changes within a second."""

SOFTWARE_MADE = 1_767_225_600.0
"""2026-01-01, in seconds since 1970. A clock that shows an earlier time was never set."""
_LATEST = 4_102_444_800.0
"""2100-01-01, in seconds since 1970."""


def is_set(seconds: float) -> bool:
    """Whether a time, in seconds since 1970, lies between 2026 and 2100. A clock outside was never set."""
    return SOFTWARE_MADE <= seconds < _LATEST


class WallClock:
    """Falls back to the autopilot's time (from GNSS) on a board whose clock has no battery."""

    def __init__(self, autopilot: Callable[[], float | None], wall: Callable[[], float] = time.time) -> None:
        """Both return seconds since 1970; `autopilot` returns None where the autopilot has no time."""
        self._autopilot_time = autopilot
        self._wall = wall

    def known(self) -> float | None:
        """Return the time in seconds since 1970, None where neither clock was set."""
        own = self._wall()
        return own if is_set(own) else self._autopilot_time()

    def stamp(self) -> float:
        """Return `known()`, or the computer's time where that is None: for records that need some time."""
        return self.known() or self._wall()


class VehiclePosition:
    """Gives the vehicle's place and time. Any thread may call it, since it only reads the newest report."""

    def __init__(self, newest: Callable[[], Vehicle | None]) -> None:
        """newest: returns the autopilot's newest report, None before its first heartbeat."""
        self._newest = newest
        self.clock = WallClock(self._autopilot_time)

    def place(self) -> Place:
        """Return the vehicle's position, heading and attitude, and the time; None for what is not known."""
        vehicle = self._newest()
        if vehicle is None:
            return Place(time=self.clock.known())
        latitude, longitude, heading = vehicle.position or (None, None, None)
        if heading is None and vehicle.attitude is not None:
            heading = vehicle.attitude[2]
        return Place(latitude, longitude, heading, self.clock.known(), vehicle.attitude)

    def _autopilot_time(self) -> float | None:
        vehicle = self._newest()
        return None if vehicle is None or vehicle.clock is None else vehicle.clock + time.monotonic()


SPEED_LASTS = 2.0
"""s after which a reported speed says no more that a vehicle stands."""


def stands(vehicle: Vehicle, now: float) -> bool:
    """Whether the vehicle is known to stand. now: seconds of the link's clock."""
    if vehicle.speed is None or vehicle.position_at is None or now - vehicle.position_at > SPEED_LASTS:
        return False
    return vehicle.speed < MOVES


def is_moving(vehicle: Vehicle | None, now: float, *, drives_itself: bool) -> bool:
    """Whether the vehicle moves. Where its speed is not known, `drives_itself` is returned.

    Of a vehicle that drives itself with throttle a speed of 0 is not believed: its positions may stand still.
    """
    speed = vehicle.speed if vehicle is not None else None
    if vehicle is None or speed is None:
        return drives_itself
    pushes = vehicle.pushes_since is not None and now - vehicle.pushes_since >= PUSHES_FOR
    return speed > MOVES or (drives_itself and pushes)


def read_place(saved: Any) -> Place:
    """Read what `place_document` made. Values that are missing or out of range are left unknown."""
    return Place(**place_attributes(saved))


class Odometer:
    """Adds up the distances between the vehicle's positions."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._metres = 0.0

    def travelled(self, position: tuple[float, float, float | None] | None) -> float | None:
        """Add the newest position (latitude and longitude in degrees), and return the metres driven so far.

        None until a first position is known.
        """
        if position is not None:
            latitude, longitude, _ = position
            if self._last is None:
                self._last = latitude, longitude
            # A flat earth is exact enough here: steps are a few metres long.
            north = (latitude - self._last[0]) * METRES_PER_DEGREE
            east = (longitude - self._last[1]) * METRES_PER_DEGREE * math.cos(math.radians(latitude))
            step = math.hypot(north, east)
            if step >= _JITTER:
                self._last = latitude, longitude
                self._metres += step if step <= _JUMP else 0.0
        return None if self._last is None else self._metres
