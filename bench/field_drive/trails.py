"""Makes a random trail with things on it and beside it; the same seed gives the same trail.

Lengths in m. Things stand every 9 to 13 m of the route:
- round: a drum or a rock in the way, with room for the vehicle beside it on the path.
- appears: the same, but it is put down only when the rover is near. Where that is nearer than the rover
  stops from its speed, it is `late`: no rule could help, and what is touched of these is counted apart.
- closed: logs across the whole path and `VERGE` to each side of it, end to end: nothing leads through.
- puddle: in the way, with room. By the seed the words say that it is drivable, and it is no obstacle then.
Beside the path stand drums and rocks, none nearer to its edge than `BESIDE`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random

import numpy as np

from companion.sim.field.things import FieldThing, World
from companion.sim.field.trail import BLEND, ZONES, Course, Trail

VEHICLE, MARGIN = 0.6, 0.3
"""Width of the vehicle, and the room that it needs on each side."""
NARROW, WIDE = 1.65, 2.25
"""Half the width of the narrowest and of the widest path, each within 0.15 m."""
SHORT, LONG = 60.0, 80.0
"""Of the route."""
_LEAD, _TAIL = 10.0, 8.0
"""From the begin of the route to the first thing, and from the last one to its end."""
_NEAR, _FAR = 9.0, 13.0
VERGE, BESIDE = 1.0, 0.5
_AFAR, _ASIDE = 20.0, 12.0
"""Along the route before and behind it, and from its middle: scenery farther away is left out."""
_SPARE = (0.1, 0.6)
"""By how much the room beside a thing is wider than what is needed."""
_BENDS, _TIGHTEST = (0.1, 0.08, 0.07, 0.06, 0.05, 0.04, 0.03, 0.03, 0.02), 10.0
_KINDS, _WEIGHTS = ("round", "appears", "closed", "puddle"), (5, 3, 1, 2)
_SIZES = {"drum": (0.29, 0.88), "rock": (0.42, 0.59), "puddle": (0.55, 0.0)}
"""Radius and height."""
_LOG_RADIUS, _LOG_LENGTH, _LOG_GAP = 0.21, 2.4, 0.1
_APPEARS = (0.6, 2.2)
"""Share of the way to stop, from the rover's front, at which a thing appears."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Something on the route that is no ground to drive on, or a puddle that is.

    things: one, or the logs of a row. s: of the trail. room: it leaves room on the path. drivable: by the
    words. appears: metres before the rover's front at which it appears, None: it is there from the begin.
    late: that is nearer than the rover can stop.
    """

    kind: str
    things: tuple[FieldThing, ...]
    s: float
    room: bool
    drivable: bool = False
    appears: float | None = None
    late: bool = False


@dataclass(frozen=True, eq=False)
class FieldRoute:
    """A trail to drive. begin, metres: of the route on it. placed: by `s`.

    puddles: whether the words call puddles drivable. swing: degrees of pitch. latency: s that are added from
    a frame's capture to its judgement.
    """

    seed: int
    world: World
    begin: float
    metres: float
    placed: tuple[Placed, ...]
    puddles: bool
    swing: float
    latency: float


def make_route(seed: int, stopping: Callable[[float], float]) -> FieldRoute:
    """Make one.

    stopping: returns the metres to standstill from when a thing can be seen, for a latency in s.
    """
    random = Random(f"field drive {seed}")
    metres, half = random.uniform(SHORT, LONG), random.uniform(NARROW, WIDE)
    # each zone has a third of the loop, so that the route has one kind of surroundings
    loop = 3 * (metres + 2 * BLEND + 10.0)
    course = Course(half, _BENDS, _TIGHTEST * 124.0 / loop)
    world = World(seed, (), loop, course)
    begin = world.trail.borders[ZONES[seed % len(ZONES)]][0] + BLEND
    world.trail.start = begin
    puddles = random.random() < 0.5
    _thin_out(world, begin, metres)
    swing, latency = random.uniform(2.0, 4.0), random.uniform(0.0, 0.3)
    placed = tuple(_placed(world.trail, random, begin, metres, stopping(latency), puddles=puddles))
    for one in placed:
        if one.appears is None:
            for thing in one.things:
                world.add(thing)
    for thing in _beside(world.trail, random, begin, metres, placed):
        world.add(thing)
    return FieldRoute(seed, world, begin, metres, placed, puddles, swing, latency)


def room_beside(trail: Trail, s: float, aside: float, radius: float) -> float:
    """Return the width of the path on the wider side of a thing that stands `aside` m left of its middle."""
    return float(trail.half_width(np.array(s))) + abs(aside) - radius


def _thin_out(world: World, begin: float, metres: float) -> None:
    """Take away scenery that is seldom seen from the route, and costs time to draw.

    Puddles go as well: whether they are drivable depends on the words.
    """
    for thing in list(world.things.values()):
        s, aside = world.trail.nearest(thing.x, thing.y)
        along = (s - begin + _AFAR) % world.trail.length
        if thing.kind == "puddle" or along > metres + 2 * _AFAR or abs(aside) > _ASIDE:
            world.remove(thing.id)


def _placed(
    trail: Trail, random: Random, begin: float, metres: float, stopping: float, *, puddles: bool
) -> Iterator[Placed]:
    at, number = _LEAD + random.uniform(0.0, 3.0), 0
    while at < metres - _TAIL:
        (kind,), s = random.choices(_KINDS, _WEIGHTS), begin + at
        at, number = at + random.uniform(_NEAR, _FAR), number + 1
        if kind == "closed":
            yield Placed(kind, tuple(_row(trail, random, s, number)), s, room=False)
            continue
        name = "puddle" if kind == "puddle" else random.choice(("drum", "rock"))
        aside = _aside(trail, random, s, _SIZES[name][0])
        thing = _thing(trail, random, f"{kind}-{number}", name, s, aside)
        appears = stopping * random.uniform(*_APPEARS) if kind == "appears" else None
        late = appears is not None and appears < stopping
        drivable = kind == "puddle" and puddles
        yield Placed(kind, (thing,), s, room=True, drivable=drivable, appears=appears, late=late)


def _aside(trail: Trail, random: Random, s: float, radius: float) -> float:
    """Draw where a thing stands: in the way of a rover in the middle, and with room on its wider side."""
    half = float(trail.half_width(np.array(s)))
    needs = VEHICLE + 2 * MARGIN + random.uniform(*_SPARE)
    nearest, farthest = max(0.0, needs + radius - half), radius + VEHICLE / 2 - 0.05
    return random.uniform(min(nearest, farthest), farthest) * random.choice((-1.0, 1.0))


def _row(trail: Trail, random: Random, s: float, number: int) -> Iterator[FieldThing]:
    wide = 2 * (float(trail.half_width(np.array(s))) + VERGE)
    count = math.ceil((wide + _LOG_GAP) / (_LOG_LENGTH + _LOG_GAP))
    for place in range(count):
        aside = (place - (count - 1) / 2) * (_LOG_LENGTH + _LOG_GAP)
        thing = _thing(trail, random, f"closed-{number}-{place}", "log", s, aside)
        thing.heading, thing.length = trail.pose(s).heading + math.pi / 2, _LOG_LENGTH
        yield thing


def _beside(
    trail: Trail, random: Random, begin: float, metres: float, placed: Sequence[Placed]
) -> Iterator[FieldThing]:
    """Yield what stands beside the path, but not beside a closed row, whose logs are there."""
    at, number = random.uniform(3.0, 8.0), 0
    while at < metres:
        s, name = begin + at, random.choice(("drum", "rock"))
        away = float(trail.half_width(np.array(s))) + BESIDE + _SIZES[name][0] + random.uniform(0.0, 1.0)
        at, number = at + random.uniform(5.0, 11.0), number + 1
        aside = away * random.choice((-1.0, 1.0))
        if not any(abs(one.s - s) < 2.0 and not one.room for one in placed):
            yield _thing(trail, random, f"beside-{number}", name, s, aside)


def _thing(trail: Trail, random: Random, name: str, kind: str, s: float, aside: float) -> FieldThing:
    at, (radius, height) = trail.pose(s), _SIZES.get(kind, (_LOG_RADIUS, 2 * _LOG_RADIUS))
    x, y = at.x - aside * math.sin(at.heading), at.y + aside * math.cos(at.heading)
    look = random.randrange(12)
    return FieldThing(name, kind, x, y, radius, height, surprise=True, look=look)
