"""Sees for a simulated rover: frames, late as its seed has it, and how it leans and moves, as the wire tells.

The frames are judged and marked in the grid by the vision process's own `Worker`, in this process.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from bench.calls.field import FilmedField
from bench.virtual_time import Clock
from companion.desk.drives.drive import DriveFrame
from companion.desk.exchange.truth import TruePerceiver
from companion.guide.plan import Errand, Plan
from companion.sim.field.render import Bytes
from companion.sim.field.rover import Rover
from companion.sim.field.trail import TrailPose
from companion.vehicle.motion import LeanFilter, MotionReport, Odometry
from companion.vision.messages import FrameJudged, Situation
from companion.vision.worker import Worker

JUDGED = 0.05
"""s that judging takes, beside the latency of the seed."""
_ATTITUDES, _QUICK = 0.25, 0.1
"""s from one report of ATTITUDE and position to the next, as usual and while they are wanted quickly."""


Sight = tuple["Filmed", FrameJudged | Plan]


class Filmed(NamedTuple):
    """A frame on its way. due: s at which it has been judged. pose: of the rover in the world."""

    due: float
    frame: DriveFrame
    number: int
    labels: Bytes
    pose: TrailPose


class Eyes:
    """Camera, motion reports and `Worker` of one drive. Times are those of the clock."""

    def __init__(
        self, engine: AnyTraverse, film: FilmedField, rover: Rover, clock: Clock, *, rate: float, late: float
    ) -> None:
        """late: s beside those of judging."""
        self._engine, self._film, self._rover, self._clock = engine, film, rover, clock
        self.worker = Worker(engine, 0)
        self._period, self._late = 1.0 / rate, JUDGED + late
        self._next = self._told = self._felt = clock.now
        self._on_way: deque[Filmed] = deque()
        self._frames = 0
        self._lean, self._odometry = LeanFilter(), Odometry()
        self._compass = 90.0 - math.degrees(rover.heading)
        self.motion: MotionReport | None = None
        self.errand: Errand | None = None
        """What is to be planned."""

    def feel(self, *, quick: bool) -> bool:
        """Note how the rover moves. Return whether a report of that has come."""
        now = self._clock.now
        if now < self._told - 1e-9:
            return False
        self._tell_motion(now, _QUICK if quick else _ATTITUDES)
        return True

    def look(self) -> Iterator[Sight]:
        """Film, and yield what has been judged by now, and planned after it."""
        now = self._clock.now
        if now >= self._next - 1e-9:
            self._next += self._period
            self._frames += 1
            rover, pose = self._rover, self._rover.pose
            frame = self._film.frame(pose, now, rover.distance, rover.attitude.tilt)
            self._on_way.append(Filmed(now + self._late, frame, self._frames, self._film.labels, pose))
        while self._on_way and self._on_way[0].due <= now + 1e-9:
            one = self._on_way.popleft()
            assert one.frame.image is not None
            if isinstance(self._engine.perceiver, TruePerceiver):
                self._engine.perceiver.show(one.labels)
            self._tell()
            judged = self.worker.judge(Frame(one.number, one.frame.at, one.frame.image))
            yield one, judged
            self.worker.remember_ground(judged.assessment)
            planned = self.worker.plan(judged.assessment)
            if planned is not None:
                yield one, planned.content

    def _tell_motion(self, now: float, period: float) -> None:
        rover, attitude = self._rover, self._rover.attitude
        angles = math.degrees(attitude.pitch), math.degrees(attitude.roll)
        rates = math.degrees(attitude.pitch_rate), math.degrees(attitude.roll_rate)
        compass = 90.0 - math.degrees(rover.heading)
        turned = math.remainder(compass - self._compass, 360.0)
        turning = turned / (now - self._felt) if now > self._felt else 0.0
        self._compass, self._felt, self._told = compass, now, now + period
        report = self._odometry.take(self._lean.take(now, angles, rates), compass, turning, rover.speed)
        self.motion = report
        self._tell()

    def _tell(self) -> None:
        place = self._film.place(self._rover.pose)
        self.worker.handle(Situation(place, motion=self.motion, errand=self.errand))
