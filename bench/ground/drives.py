"""Drives the simulated trail with things on it, and keeps what the perceivers make of each frame.

Drums, rocks and logs stand every 5 m of the first two thirds, up to 0.9 m beside the middle of the trail; the
rover keeps to the middle as if they were not there. The last third is free. No two seeds begin at one place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Maps
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Pose
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver, make_perceiver
from bench.ground.rides import FPS, JUDGED, SPEED, reports
from companion.desk.exchange.drive import WORDS
from companion.desk.exchange.truth import TruePerceiver
from companion.sim.field.motion import RoverMotion
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import FieldThing, World
from companion.sim.field.trail import TrailPose
from companion.vehicle.motion import lean_at

Floats = NDArray[np.float64]

PERCEIVERS = ("truth", "builtin")
_SIZES = {"drum": (0.29, 0.88, 0.0), "rock": (0.42, 0.59, 0.0), "log": (0.21, 0.42, 2.3)}
"""Radius, height and length in m."""
_GAP, _ASIDE, _IN_THE_WAY = 5.0, 0.9, 0.15
_SEEDS = 5
_BEGIN = 10.0
"""s of the motion before the first frame: its slow part is known then."""


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A frame. pose: the rover's, rad. lean: as the companion knows it. maps: by perceiver."""

    at: float
    pose: TrailPose
    lean: tuple[float, float] | None
    maps: dict[str, Maps]


@dataclass(frozen=True, eq=False)
class Placed:
    """A thing that was put on the trail. aside: m from its middle. middle: a drum that nobody passes."""

    thing: FieldThing
    aside: float
    middle: bool

    def in_the_way(self, half: float) -> bool:
        """Whether a vehicle so wide on each side comes within 0.3 m of it."""
        return abs(self.aside) - max(self.thing.radius, self.thing.length / 2) < half + 0.3


@dataclass(frozen=True, eq=False)
class FieldDrive:
    """A drive, of which the frames can be taken once."""

    world: World
    placed: tuple[Placed, ...]
    frames: Iterator[SeenFrame]


class Odometry:
    """Tells where the rover is, and counts `speed` too much of each way, and `turn` degrees/s too much."""

    def __init__(self, speed: float, turn: float) -> None:
        self._speed, self._turn = 1.0 + speed, math.radians(turn)
        self._last: SeenFrame | None = None
        self._place, self._drift = (0.0, 0.0), 0.0

    def at(self, frame: SeenFrame) -> Pose:
        """Return the pose that it tells of a frame, the next one."""
        if self._last is not None:
            self._drift += self._turn * (frame.at - self._last.at)
            dx, dy = frame.pose.x - self._last.pose.x, frame.pose.y - self._last.pose.y
            c, s = math.cos(self._drift) * self._speed, math.sin(self._drift) * self._speed
            self._place = self._place[0] + c * dx - s * dy, self._place[1] + s * dx + c * dy
        self._last = frame
        return Pose(*self._place, math.degrees(frame.pose.heading + self._drift))


def drive(seed: int, swing: float, metres: float, perceivers: Sequence[str] = PERCEIVERS) -> FieldDrive:
    """Drive so many metres. swing: degrees."""
    world, rng = World(seed, ()), np.random.default_rng([seed, 8])
    start = world.trail.start + seed % _SEEDS * world.trail.length / _SEEDS
    placed = tuple(_place(world, start, metres, rng))
    engines = {name: _engine(name) for name in perceivers}
    return FieldDrive(world, placed, _frames(world, start, metres, swing, rng, engines))


def gaps(thing: FieldThing, pose: TrailPose, ground: Floats) -> Floats:
    """Return the m from places (n, 2), ahead of a rover's lens and to its left, to a thing's rim.

    Below 0 inside: as `World.contact` counts.
    """
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    dx = pose.x + ground[:, 0] * c - ground[:, 1] * s - thing.x
    dy = pose.y + ground[:, 0] * s + ground[:, 1] * c - thing.y
    c, s = math.cos(thing.heading), math.sin(thing.heading)
    half = max(0.0, thing.length / 2 - thing.radius)
    along = np.maximum(0.0, np.abs(dx * c + dy * s) - half)
    return np.asarray(np.hypot(along, dy * c - dx * s) - thing.radius)


def _frames(
    world: World,
    start: float,
    metres: float,
    swing: float,
    rng: np.random.Generator,
    engines: dict[str, AnyTraverse],
) -> Iterator[SeenFrame]:
    motion = RoverMotion(world.trail, world.seed, swing=math.radians(swing))
    camera, count = PinholeCamera(world, seed=world.seed), round(metres / SPEED * FPS)
    told = list(reports(motion, _BEGIN + count / FPS, rng))
    for number in range(count):
        at, s = _BEGIN + number / FPS, start + SPEED * number / FPS
        pose, tilt = world.trail.pose(s), motion.at(at, s, SPEED).tilt
        world.light = 1 + 0.4 * math.sin(at / 7)
        image, labels = camera.render(pose, at, tilt)
        known = [one for one in told if one.at <= at + JUDGED][-8:]
        maps = dict[str, Maps]()
        for name, engine in engines.items():
            if isinstance(engine.perceiver, TruePerceiver):
                engine.perceiver.show(labels)
            found = engine.judge(engine.observe(Frame(number + 1, at, image)), at).maps
            assert found is not None
            maps[name] = found
        yield SeenFrame(at, pose, lean_at(known, at), maps)


def _place(world: World, start: float, metres: float, rng: np.random.Generator) -> Iterator[Placed]:
    for number in range(int((metres * 2 / 3 - 8.0) / _GAP) + 1):
        kind = ("drum", "rock", "drum", "log")[number % 4]
        reach = _IN_THE_WAY if number % 4 == 0 else _ASIDE
        s, aside = start + 8.0 + _GAP * number + rng.uniform(-1.0, 1.0), float(rng.uniform(-reach, reach))
        at, (radius, height, length) = world.trail.pose(s), _SIZES[kind]
        x, y = at.x - aside * math.sin(at.heading), at.y + aside * math.cos(at.heading)
        thing = FieldThing(f"{kind}-{number}", kind, x, y, radius, height, surprise=True)
        thing.look, thing.heading, thing.length = int(rng.integers(0, 12)), at.heading + math.pi / 2, length
        world.add(thing)
        yield Placed(thing, aside, number % 4 == 0)


def _engine(name: str) -> AnyTraverse:
    perceiver: Perceiver = TruePerceiver() if name == "truth" else make_perceiver("builtin")
    return AnyTraverse(perceiver, Settings.of(perceiver.defaults), first_memory(perceiver.model_id, WORDS))
