"""Where the vehicle is and what time it is, as far as anybody says."""

from __future__ import annotations

import time

from anytraverse.history import Place
from companion.calls.machine import OperatorCalls
from companion.link.link import Link
from companion.wall_clock import WallClock

MOVES = 0.2
"""m/s above which a vehicle moves: enough to change what its camera sees within a second."""


class Whereabouts:
    """Asked from any thread: it only reads the newest that the autopilot said."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.clock = WallClock(self._told)

    def place(self) -> Place:
        """Where the vehicle is now, how it stands, and when that is."""
        vehicle = self._link.vehicle
        if vehicle is None:
            return Place(time=self.clock.known())
        latitude, longitude, heading = vehicle.position or (None, None, None)
        if heading is None and vehicle.attitude is not None:
            heading = vehicle.attitude[2]
        return Place(latitude, longitude, heading, self.clock.known(), vehicle.attitude)

    def _told(self) -> float | None:
        vehicle = self._link.vehicle
        return None if vehicle is None or vehicle.clock is None else vehicle.clock + time.monotonic()


def is_moving(link: Link, calls: OperatorCalls) -> bool:
    """Whether the vehicle moves; where its speed is not known, whether it drives by itself."""
    speed = link.vehicle.speed if link.vehicle is not None else None
    return calls.autopilot.drives_itself if speed is None else speed > MOVES
