"""Drives one vehicle along a simulated trail, and judges each frame by several regions of interest.

Drum, rock and log stand on the trail, drums beside it. Nothing is answered, so that nothing is learnt, and
scenes are not compared: a frame is judged as by an engine that has just started.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Assessment, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.ground import RELIABLE
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver
from anytraverse.preferences import Preferences
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import ReasonFilter
from companion.desk.exchange.truth import TruePerceiver
from companion.desk.exchange.vehicles import ExchangeVehicle
from companion.sim.field.album import shown_kind
from companion.sim.field.lens import relative
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import DEFAULT_SURPRISES, FieldThing, World

RATE = 10.0
"""Frames/s of the simulated time."""
ROOM = 0.3
"""Metres on each side of the vehicle that belong to its way: it is not steered to the centimetre."""
WORDS = Preferences.parse(
    "grass: 1; dirt path: 1; gravel: 1; sky: -0.5; bush: -1; tree: -1; puddle: -1",
)
_STOPS = frozenset({Reason.UNKNOWN_OBJECT, Reason.BLOCKED})
"""Reasons that call the operator, or hold the vehicle where a word was found in the thing."""
_BESIDE = (1.0, 1.1, 1.2, 1.2, 1.3, 1.4)
"""Metres of the drums beside the trail from its middle."""
_PASSED = -1.5
_SIZES = {"drum": (0.29, 0.88, 0.0), "rock": (0.42, 0.59, 0.0), "log": (0.21, 0.42, 2.3)}
"""Radius, height and length in m."""
_WIDER = 1.25


@dataclass(frozen=True)
class Placed:
    """A thing that was put down. s, aside: where, along the trail and to the left of its middle, m."""

    thing: FieldThing
    s: float
    aside: float

    @property
    def on_trail(self) -> bool:
        """Whether every vehicle would hit it."""
        return abs(self.aside) < min(_BESIDE)

    def in_way(self, vehicle: ExchangeVehicle) -> bool:
        """Whether it reaches into what the vehicle sweeps, with `ROOM` on each side."""
        radius = max(self.thing.radius, self.thing.length / 2)
        return abs(self.aside) - radius < vehicle.region.vehicle / 2 + ROOM


@dataclass
class Approach:
    """How a thing on the trail was noticed. Distances in m from the vehicle's front to the thing's foot.

    first: in the first frame that shows it as bad. call: when the call opened. None: never. bend: m by which
    the trail leaves the straight way ahead of the vehicle on the way that the region is long.
    """

    kind: str
    seed: int
    bend: float
    first: float | None = None
    call: float | None = None


@dataclass(eq=False)
class CallView:
    """A frame with which a call opened."""

    seen: Assessment
    settings: Settings
    distance: float


@dataclass(eq=False)
class RegionTally:
    """What one region led to. free: m driven with nothing ahead that stands in the vehicle's way.

    needless: calls on these for what stands beside the way, or for nothing. views: kind -> its call.
    """

    approaches: list[Approach] = field(default_factory=list)
    free: float = 0.0
    needless: int = 0
    frames: int = 0
    views: dict[str, CallView] = field(default_factory=dict)

    def add(self, other: RegionTally) -> None:
        """Add what came of another trail."""
        self.approaches += other.approaches
        self.free += other.free
        self.needless += other.needless
        self.frames += other.frames
        self.views = {**other.views, **self.views}


def make_trail(seed: int) -> tuple[World, list[Placed]]:
    """Make a trail, with the things at equal distances in an order of the seed's."""
    world, rng = World(seed, ()), np.random.default_rng([seed, 5])
    beside = [("drum", float(away * rng.choice((-1, 1)))) for away in rng.permutation(_BESIDE)]
    ahead = [(str(kind), float(rng.uniform(-0.15, 0.15))) for kind in rng.permutation(DEFAULT_SURPRISES)]
    order = [one for two in zip(ahead, beside[::2], beside[1::2], strict=True) for one in two]
    gap, placed = world.trail.length / len(order), list[Placed]()
    for number, (kind, aside) in enumerate(order):
        s = (world.trail.start + gap * (number + 1) - 2.0 + float(rng.uniform(-1, 1))) % world.trail.length
        at, (radius, height, length) = world.trail.pose(s), _SIZES[kind]
        x, y = at.x - aside * math.sin(at.heading), at.y + aside * math.cos(at.heading)
        look, across = int(rng.integers(0, 12)), at.heading + math.pi / 2
        thing = FieldThing(f"{kind}-{number}", kind, x, y, radius, height, surprise=True)
        thing.look, thing.heading, thing.length = look, across, length
        world.add(thing)
        placed.append(Placed(thing, s, aside))
    return world, placed


def drive(
    vehicle: ExchangeVehicle,
    regions: Sequence[Settings],
    perceiver: Perceiver,
    seed: int,
    metres: float = math.inf,
) -> list[RegionTally]:
    """Drive a lap, or so many metres of it, by each of `regions`; return their tallies in this order."""
    world, placed = make_trail(seed)
    trail, step = world.trail, vehicle.speed / RATE
    camera = PinholeCamera(world, seed=seed, mount=vehicle.mount)
    engine = AnyTraverse(perceiver, regions[0], first_memory(perceiver.model_id, WORDS))
    watches = [_Watch(vehicle, settings, placed, world, seed) for settings in regions]
    for number in range(int(min(metres, trail.length) / step)):
        now, s = number / RATE, (trail.start + number * step) % trail.length
        world.light = 1 + 0.4 * math.sin(now / 7)
        image, labels = camera.render(trail.pose(s), now)
        if isinstance(perceiver, TruePerceiver):
            perceiver.show(labels)
        observation = engine.observe(Frame(number + 1, now, image))
        for watch in watches:
            engine.settings = watch.settings
            watch.take(engine.judge(observation, now), labels, now, s)
    return [watch.tally for watch in watches]


class _Watch:
    """Watches what one region makes of a drive."""

    def __init__(
        self, vehicle: ExchangeVehicle, settings: Settings, placed: list[Placed], world: World, seed: int
    ) -> None:
        self.settings, self.tally = settings, RegionTally()
        self._vehicle, self._placed, self._trail = vehicle, placed, world.trail
        call = vehicle.config.call
        self._filter = ReasonFilter(Numbers(settings, call.votes, call.window), 0.0)
        self._approaches = {
            one.thing.id: Approach(one.thing.kind, seed, self._bend(one)) for one in placed if one.on_trail
        }
        self._in_way = {one.thing.id for one in placed if one.in_way(vehicle)}
        self._reached = set[str]()
        self._called = set[str]()
        self._open = False

    def take(self, seen: Assessment, labels: NDArray[np.uint8], now: float, s: float) -> None:
        """Take in a judged frame, taken at `s` m of the trail."""
        ahead = {one.thing.id: self._distance(one, s) for one in self._placed}
        self._end_approaches(ahead)
        self._filter.add_frame(seen, now, None)
        bad = bool(seen.reasons & _STOPS)
        active = bool(self._filter.reasons(now) & _STOPS)
        cause = self._cause(seen, labels, ahead) if bad else None
        free = not any(_PASSED < ahead[name] < RELIABLE + 1.0 for name in self._in_way)
        approach = self._approaches.get(cause.thing.id) if cause is not None else None
        if cause is not None and approach is not None:
            left = ahead[cause.thing.id]
            approach.first = left if approach.first is None else approach.first
            if active and approach.call is None:
                approach.call = left
                self.tally.views[approach.kind] = CallView(seen, self.settings, left)
        elif free and bad and active:
            self.tally.needless += self._is_another(cause)
        self._open = active
        self.tally.free += free * self._vehicle.speed / RATE
        self.tally.frames += 1

    def _is_another(self, cause: Placed | None) -> bool:
        """Return whether a call is for a thing that none was for, or for no thing and none was open."""
        if cause is None:
            return not self._open
        another = cause.thing.id not in self._called
        self._called.add(cause.thing.id)
        return another

    def _end_approaches(self, ahead: dict[str, float]) -> None:
        """Count a thing on the trail once the front has reached it."""
        for name, approach in self._approaches.items():
            if name not in self._reached and -1.0 < ahead[name] <= 0.0:
                self._reached.add(name)
                self.tally.approaches.append(approach)

    def _cause(self, seen: Assessment, labels: NDArray[np.uint8], ahead: dict[str, float]) -> Placed | None:
        """Return the thing that the frame's tile shows, None where it shows none that was put down."""
        if seen.tile is None:
            return None
        kind = shown_kind(labels, seen.tile.shown.grown(_WIDER))
        found = [one for one in self._placed if one.thing.kind == kind and ahead[one.thing.id] > _PASSED]
        return min(found, key=lambda one: ahead[one.thing.id], default=None)

    def _distance(self, one: Placed, s: float) -> float:
        """Return the metres along the trail from the vehicle's front to a thing's foot; below 0: passed."""
        return math.remainder(one.s - s, self._trail.length) - self._vehicle.camera.front

    def _bend(self, one: Placed) -> float:
        ground = self.settings.ground
        away = 0.0 if ground is None else ground.far + ground.camera.front
        at = self._trail.pose(one.s)
        return abs(relative(self._trail.pose(one.s - away), at.x, at.y)[1])
