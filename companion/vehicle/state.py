"""What the autopilot said last: where the vehicle is, how it moves, and what time it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from anytraverse.history import Place
from companion.system.wall_clock import WallClock


@dataclass(frozen=True)
class Vehicle:
    """The newest that the autopilot said. Times in s of the link's `now`.

    autopilot: MAV_AUTOPILOT. type: MAV_TYPE. heard_at: its last heartbeat. mode_at: its last CURRENT_MODE.
    position: (latitude, longitude, heading or None) in degrees, None without a fix or when older than 5 s.
    speed: over ground, m/s, known with the position. attitude: roll, pitch, yaw in degrees, None when older
    than 5 s. clock: its time when `now` was 0, s since 1970; None where it knows none.
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
    clock: float | None = None
    clock_at: float | None = None


MOVES = 0.2
"""m/s above which a vehicle moves: enough to change what its camera sees within a second."""


class VehiclePosition:
    """Asked from any thread: it only reads the newest that the autopilot said."""

    def __init__(self, newest: Callable[[], Vehicle | None]) -> None:
        """newest: what the autopilot said last, None before it was heard."""
        self._newest = newest
        self.clock = WallClock(self._told)

    def place(self) -> Place:
        """Where the vehicle is now, how it stands, and when that is."""
        vehicle = self._newest()
        if vehicle is None:
            return Place(time=self.clock.known())
        latitude, longitude, heading = vehicle.position or (None, None, None)
        if heading is None and vehicle.attitude is not None:
            heading = vehicle.attitude[2]
        return Place(latitude, longitude, heading, self.clock.known(), vehicle.attitude)

    def _told(self) -> float | None:
        vehicle = self._newest()
        return None if vehicle is None or vehicle.clock is None else vehicle.clock + time.monotonic()


def is_moving(vehicle: Vehicle | None, *, drives_itself: bool) -> bool:
    """Whether the vehicle moves. drives_itself: what counts where its speed is not known."""
    speed = vehicle.speed if vehicle is not None else None
    return drives_itself if speed is None else speed > MOVES
