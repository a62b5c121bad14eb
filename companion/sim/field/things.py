"""Places the things along the simulated trail: scenery beside the path, and surprises on it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from companion.sim.field.trail import LOOP, ZONES, Course, Trail

KINDS = ("bush", "tree", "puddle", "drum", "rock", "log")
DEFAULT_SURPRISES = ("drum", "rock", "log")
CLEAR = 2.4  # m from the centre line within which no bush or tree stands; of a wider path as much more
PUDDLE_CLEAR = 1.9  # m from the centre line to the rim of a puddle; likewise
_SPACING = 3.5  # m, the least distance between two surprises

# For each zone and kind: how many stand in 10 m of the route, and the least and largest distance from the
# centre line (m).
_SCENERY = {
    "meadow": {"bush": (2.6, 3.2, 16.0), "tree": (0.9, 8.0, 22.0), "puddle": (0.5, 2.6, 3.4)},
    "forest": {"bush": (7.0, 2.9, 12.0), "tree": (26.0, 3.0, 17.0), "puddle": (0.4, 2.6, 3.4)},
    "gravel": {"bush": (1.6, 3.6, 14.0), "tree": (0.3, 10.0, 20.0), "puddle": (0.6, 2.6, 3.4)},
}


@dataclass
class FieldThing:
    """One thing: its place, radius and height in metres.

    A log lies at `heading` (radians), is `length` metres long, and `radius` is half its thickness.
    `look` picks one of its kind's looks (a drum's colour, a bush's shape).
    """

    id: str
    kind: str
    x: float
    y: float
    radius: float
    height: float
    surprise: bool
    look: int = 0
    heading: float = 0.0
    length: float = 0.0


class World:
    """The trail and all things on it; the same seed and surprises give the same world.

    `surprises` are kinds, given to meadow, forest and gravel in turn; by default a drum, a rock and a log.
    length, course: as of `Trail`. Raises ValueError for an unknown kind, or for more than fit.
    """

    def __init__(
        self,
        seed: int,
        surprises: Sequence[str] = DEFAULT_SURPRISES,
        length: float | None = None,
        course: Course = LOOP,
    ) -> None:
        self.seed = seed
        self.trail = Trail(seed, length, course)
        self.light = 1.0
        self.revision = 0  # counts changes, so that a camera knows when to draw the shadows again
        self.things: dict[str, FieldThing] = {}
        for thing in [*_surprises(self.trail, seed, surprises), *_scenery(self.trail, seed)]:
            self.things[thing.id] = thing

    def add(self, thing: FieldThing) -> None:
        """Puts a thing down. Raises ValueError where there is one of that id."""
        if thing.id in self.things:
            raise ValueError(f"{thing.id} is there already: give another id")
        self.things[thing.id] = thing
        self.revision += 1

    def remove(self, thing_id: str) -> None:
        """Takes a thing away. Raises KeyError when there is none of that id."""
        self._known(thing_id)
        del self.things[thing_id]
        self.revision += 1

    def move(self, thing_id: str, x: float, y: float) -> None:
        """Moves a thing (metres). Raises KeyError for an unknown id, ValueError if x or y is not finite."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError(f"{thing_id} cannot be moved to ({x}, {y}): give finite metres")
        thing = self._known(thing_id)
        thing.x, thing.y = x, y
        self.revision += 1

    def contact(self, x: float, y: float, radius: float) -> list[str]:
        """Returns the ids of the things that a disc of this radius (m) at x, y touches, nearest first."""
        gaps = [(_gap(thing, x, y) - radius, thing.id) for thing in list(self.things.values())]
        return [thing_id for gap, thing_id in sorted(gaps) if gap <= 0]

    def _known(self, thing_id: str) -> FieldThing:
        if thing_id not in self.things:
            raise KeyError(f"no thing {thing_id!r} here; there are: {', '.join(self.things)}")
        return self.things[thing_id]


def _gap(thing: FieldThing, x: float, y: float) -> float:
    """Returns the distance from a point to the rim of a thing in metres, negative inside."""
    dx, dy = x - thing.x, y - thing.y
    c, s = math.cos(thing.heading), math.sin(thing.heading)
    half = max(0.0, thing.length / 2 - thing.radius)
    along = max(0.0, abs(dx * c + dy * s) - half)
    return math.hypot(along, dy * c - dx * s) - thing.radius


def _surprises(trail: Trail, seed: int, kinds: Sequence[str]) -> Iterator[FieldThing]:
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise ValueError(f"no such surprise: {', '.join(unknown)}; known are {', '.join(KINDS)}")
    rng = np.random.default_rng([seed, 2])
    meadow, forest, gravel = (trail.borders[zone] for zone in ZONES)
    windows = {
        "meadow": (trail.start + 18.0, meadow[1] - 9.0),
        "forest": (forest[0] + 15.5, forest[1] - 10.0),
        "gravel": (gravel[0] + 15.5, gravel[1] - 10.0),
    }
    counts = dict.fromkeys(KINDS, 0)
    for place, zone in enumerate(ZONES):
        dealt = list(kinds[place :: len(ZONES)])
        begin, end = windows[zone]
        slot = (end - begin) / max(1, len(dealt))
        if len(dealt) > 1 and slot < _SPACING:
            raise ValueError(
                f"{len(dealt)} surprises do not fit into the {zone}: give fewer than {len(kinds)}"
            )
        for i, kind in enumerate(dealt):
            margin = 0.0 if len(dealt) == 1 else 0.2
            s = begin + slot * (i + rng.uniform(margin, 1 - margin))
            counts[kind] += 1
            yield _surprise(trail, kind, f"{kind}-{counts[kind]}", s, rng)


def lying_across(trail: Trail, s: float, length: float = 7.0) -> FieldThing:
    """Makes a log across the path, over all of its width and more. length: m, up to which it is."""
    at, square = trail.pose(s), math.pi / 2
    return FieldThing(
        "log-across",
        "log",
        at.x,
        at.y,
        0.22,
        0.44,
        surprise=True,
        heading=at.heading + square,
        length=length,
    )


def _surprise(trail: Trail, kind: str, thing_id: str, s: float, rng: np.random.Generator) -> FieldThing:
    reach = {"drum": 0.3, "rock": 0.4, "log": 0.15}.get(kind, 0.3)
    at = trail.pose(s)
    lateral = float(rng.uniform(-reach, reach))
    thing = _make(
        kind, thing_id, at.x - lateral * math.sin(at.heading), at.y + lateral * math.cos(at.heading), rng
    )
    thing.surprise = True
    if kind == "log":
        thing.heading = at.heading + math.pi / 2 + float(rng.uniform(-0.2, 0.2))
    return thing


def _scenery(trail: Trail, seed: int) -> Iterator[FieldThing]:
    rng = np.random.default_rng([seed, 3])
    counts = dict.fromkeys(KINDS, 0)
    wider = trail.course.half - LOOP.half
    for zone, kinds in _SCENERY.items():
        begin, end = trail.borders[zone]
        for kind, (per_ten, near, far) in kinds.items():
            for _ in range(max(1, round(per_ten * (end - begin) / 10))):
                at = trail.pose(float(rng.uniform(begin, end)))
                away = (
                    near + wider + (far - near) * float(rng.uniform()) ** (1.3 if zone == "forest" else 1.0)
                )
                away = math.copysign(away, rng.uniform(-1, 1))
                x, y = at.x - away * math.sin(at.heading), at.y + away * math.cos(at.heading)
                thing = _make(kind, f"wild-{kind}", x, y, rng)
                s, lateral = trail.nearest(x, y)
                free = wider + (PUDDLE_CLEAR if kind == "puddle" else CLEAR)
                if abs(lateral) - thing.radius < free or trail.zone(s) != zone:
                    continue
                counts[kind] += 1
                thing.id = f"{zone}-{kind}-{counts[kind]}"
                yield thing


def _make(kind: str, thing_id: str, x: float, y: float, rng: np.random.Generator) -> FieldThing:
    """Makes one thing of a kind, of a random plausible size; metres."""
    radius, height, length = {
        "bush": (rng.uniform(0.45, 0.95), rng.uniform(0.8, 1.7), 0.0),
        "tree": (rng.uniform(0.13, 0.26), rng.uniform(6.0, 9.5), 0.0),
        "puddle": (rng.uniform(0.5, 0.9), 0.0, 0.0),
        "drum": (0.29, 0.88, 0.0),
        "rock": (rng.uniform(0.35, 0.5), 0.0, 0.0),
        "log": (rng.uniform(0.18, 0.24), 0.0, rng.uniform(2.0, 2.6)),
    }[kind]
    height = {"rock": radius * 1.4, "log": radius * 2}.get(kind, height)
    look = int(rng.integers(0, 12))
    return FieldThing(
        thing_id, kind, x, y, float(radius), float(height), surprise=False, look=look, length=float(length)
    )
