"""Simulates world, rover and autopilot together in virtual time, and logs what has happened."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.rover import STEP, Rover

if TYPE_CHECKING:
    from companion.sim.field.motion import RoverMotion
    from companion.sim.field.router import Port
    from companion.sim.field.things import World


AHEAD = 20.0
BESIDE = 2.0
MAX_CONTACTS = 500
LONGEST_GAP = 0.5


class Simulation:
    """The simulation; only `advance` lets time pass, and nothing here sleeps or reads a clock.

    A thread that renders `world` must hold `lock`; `world` is changed under `lock` alone.
    """

    def __init__(
        self,
        world: World,
        send: Callable[[Port, bytes], bool],
        *,
        cruise_speed: float = 2.5,
        autopilot: type[SimulatedAutopilot] = SimulatedAutopilot,
        mission: float | None = None,
        motion: RoverMotion | None = None,
    ) -> None:
        """mission: m of the trail after which the mission is complete; None: it goes round.

        motion: of the rover; None: it stays level.
        """
        self.world = world
        self.lock = threading.Lock()
        self.rover = Rover(world.trail, cruise_speed=cruise_speed, motion=motion)
        self.autopilot = autopilot(self.rover, send)
        self.autopilot.tour.length = mission
        self.contacts: deque[dict[str, Any]] = deque(maxlen=MAX_CONTACTS)
        self._touching: set[str] = set()
        self._places: dict[tuple[str, float, float], tuple[float, float]] = {}
        self._hand_until = 0.0

    def advance(self, dt: float) -> None:
        """Lets `dt` s pass, `LONGEST_GAP` at most: while the process was suspended the world stood still."""
        left = min(dt, LONGEST_GAP)
        while left > 0:
            self.rover.step(min(left, STEP))
            left -= STEP
            self._note_contacts()
        if self.rover.time >= self._hand_until:
            self.rover.transmitter.throttle = self.rover.transmitter.steering = 0.0

    def set_sticks(self, throttle: float, steering: float, seconds: float) -> None:
        """Sets the pilot's throttle and steering, [-1, 1], for `seconds`, then 0. They act in MANUAL only."""
        self.rover.transmitter.throttle, self.rover.transmitter.steering = throttle, steering
        self._hand_until = self.rover.time + seconds

    def remove(self, thing: str) -> None:
        with self.lock:
            self.world.remove(thing)

    def move(self, thing: str, x: float, y: float) -> None:
        with self.lock:
            self.world.move(thing, x, y)

    def light(self, level: float) -> None:
        with self.lock:
            self.world.light = level

    def status(self) -> dict[str, Any]:
        """Returns what an onlooker sees, as JSON types: lengths in m, rover times in s, headings in rad.

        pitch, roll and slope_ahead (of the ground that the camera sees) are in degrees.
        """
        rover, autopilot, attitude = self.rover, self.autopilot, self.rover.attitude
        return {
            "t": round(rover.time, 3),
            "s": rover.s,
            "x": rover.x,
            "y": rover.y,
            "heading": rover.heading,
            "pitch": math.degrees(attitude.pitch),
            "roll": math.degrees(attitude.roll),
            "slope_ahead": math.degrees(attitude.slope_ahead),
            "zone": self.world.trail.zone(rover.s),
            "speed": rover.speed,
            "mode": autopilot.mode.name,
            "armed": autopilot.armed,
            "mission_complete": autopilot.tour.complete,
            "laps": rover.laps,
            "distance": rover.distance,
            "standstill": round(rover.standstill, 3),
            "contacts": list(self.contacts),
            "mode_log": [
                {"t": round(change.t, 3), "mode": change.mode.name, "by": change.by}
                for change in autopilot.mode_log
            ],
            "things_ahead": self.things_ahead(),
        }

    def things_ahead(self) -> list[dict[str, Any]]:
        """Returns the things within `BESIDE` m of the path's middle on the next `AHEAD` m, nearest first."""
        found = []
        for thing in self.world.things.values():
            s, lateral = self._place(thing.id, thing.x, thing.y)
            distance = (s - self.rover.s) % self.world.trail.length
            if distance <= AHEAD and abs(lateral) - thing.radius <= BESIDE:
                found.append(
                    {
                        "id": thing.id,
                        "kind": thing.kind,
                        "surprise": thing.surprise,
                        "distance": distance,
                        "lateral": lateral,
                    }
                )
        return sorted(found, key=lambda entry: float(entry["distance"]))

    def _place(self, thing: str, x: float, y: float) -> tuple[float, float]:
        key = (thing, x, y)
        if key not in self._places:
            if len(self._places) > 4 * len(self.world.things):
                self._places.clear()
            self._places[key] = self.world.trail.nearest(x, y)
        return self._places[key]

    def _note_contacts(self) -> None:
        rover = self.rover
        touched = set(self.world.contact(rover.x, rover.y, rover.body.radius))
        for thing in sorted(touched - self._touching):
            self.contacts.append(
                {
                    "t": round(rover.time, 3),
                    "id": thing,
                    "kind": self.world.things[thing].kind,
                    "speed": round(math.fabs(rover.speed), 3),
                }
            )
        self._touching = touched
