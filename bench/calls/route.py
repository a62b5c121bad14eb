"""Drives a long route of simulated worlds twice: calls, the operator's time, and contacts.

A world is a loop of 1 km: meadow, forest and gravel, a third each, with a thing on the way every 100 m. A
rover drives each by the body and the brakes of the simulated field, and stands where it would be held. Its
operator names a thing in the way -1, and never says go to it; somebody takes it away once the rover stands.
In the second lap all things lie there again. A rover that stands with nothing in its way is driven by hand.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.memory import Memory, first_memory
from bench.calls.engines import alone, of_the_field
from bench.calls.field import DRIVABLE, FilmedField
from bench.calls.operators import AnsweredCall, Listed, operator
from companion.calls.decisions import Call
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.desk.memory.command import merged
from companion.desk.memory.scene_file import Scene
from companion.desk.tuning.trial import Combination, Trial, run_trials
from companion.sim.field.rover import STANDSTILL, MotorDrive, Rover
from companion.sim.field.things import DEFAULT_SURPRISES, World
from companion.wire.ids import Motion
from companion.wire.typed_answers import CommandError

RATE, SPEED = 2.5, 1.2
"""Frames/s, and m/s. So it stops in a shorter way than the demo's rover with 4 frames/s at 1.5 m/s."""
WORLD_M, APART_M = 1000.0, 100.0
"""Metres of a world, and from thing to thing."""
FIRST_SEED = 100
"""Of the first world. They are not those of the trail."""
ANSWER_S = 10.0
"""Seconds that an answer is taken to cost an operator."""
NEAR_M = 13.0
"""Metres ahead within which a thing is in the way: drums are asked about from 10 to 13 m."""
TAKEN_S, BY_HAND_S = 1.5, 4.0
"""Seconds that the rover must have stood until a thing is taken away, and until it is driven on by hand."""
PASSED_M = 3.0
"""Metres from a thing at which a person who films the route by hand has it out of the way."""
OPERATOR = "word"
SLOWEST = 20.0
"""How many times as long as without a stop a world may take."""
_SUBSTEPS = 4


@dataclass(frozen=True)
class Route:
    """Names a route. kilometres: its worlds. rehearsed: its second lap alone, after a rehearsal of the first.

    metres: of a world, for tests.
    """

    kilometres: int = 10
    rehearsed: bool = False
    metres: float = WORLD_M


@dataclass
class LapResult:
    """Holds what a lap led to. due: calls that are the first about a thing or a stretch of ground.

    taken: things taken away before the rover. by_hand: times that it was driven on by hand.
    """

    metres: float = 0.0
    seconds: float = 0.0
    calls: list[AnsweredCall] = field(default_factory=list)
    due: int = 0
    contacts: list[str] = field(default_factory=list)
    taken: int = 0
    by_hand: int = 0


@dataclass
class RouteClock:
    """Holds the seconds since the begin, and the metres driven, over all worlds and laps."""

    at: float = 0.0
    driven: float = 0.0

    def next(self) -> float:
        """Let a frame's time pass, and return the time then."""
        self.at += 1 / RATE
        return self.at


class Worlds:
    """The route's worlds, one after the other. Each is made once."""

    def __init__(self, kilometres: int, metres: float = WORLD_M) -> None:
        """metres: of each world."""
        self._count, self._metres = kilometres, metres
        self._made: list[FilmedField] = []

    def each(self) -> Iterator[FilmedField]:
        """Yield each world with all its things."""
        for number in range(self._count):
            if number == len(self._made):
                self._made.append(self._world(number))
            self._made[number].put_back()
            yield self._made[number]

    def _world(self, number: int) -> FilmedField:
        kinds = [DEFAULT_SURPRISES[(number + place) % 3] for place in range(round(self._metres / APART_M))]
        world = World(FIRST_SEED + number, kinds, self._metres)
        return FilmedField(world, name=f"km {number + 1}: ", east_m=2 * self._metres * number)


class RouteRover:
    """Drives one world of a lap, and stands where it would be held."""

    def __init__(
        self, film: FilmedField, judge: DriveJudge, lap: LapResult, asked: set[str], clock: RouteClock
    ) -> None:
        """asked: things and stretches of ground that were asked about in any lap."""
        self._film, self._judge, self._lap, self._asked, self._clock = film, judge, lap, asked, clock
        self._rover = Rover(film.world.trail, cruise_speed=SPEED)
        self._operator = Listed(operator(OPERATOR, film.operator, DRIVABLE), film.about, lap.calls)
        self._stood_s = 0.0
        self._by_hand = False
        self._waits = 0
        """The call that gets a go once nothing is in the way; 0 for none."""
        self._touching: set[str] = set()

    def drive(self, metres: float | None = None) -> None:
        """Drive so far, or to the end of the world. Raises TimeoutError where the rover gets stuck."""
        rover, clock = self._rover, self._clock
        length = self._film.world.trail.length if metres is None else metres
        begun, since = clock.driven, clock.at
        while rover.progress < length:
            if clock.at - since > SLOWEST * length / SPEED:
                raise TimeoutError(f"the rover stands at {rover.progress:.0f} m of {length:.0f} m")
            clock.driven = begun + rover.distance
            frame = self._film.frame(rover.pose, clock.next(), clock.driven)
            judged = self._judge.judge(frame)
            if judged is not None and judged.opened is not None:
                self._answer(judged.opened, frame)
            self._help(frame.at)
            rover.drive = MotorDrive.HOLD if self._judge.holding and not self._by_hand else MotorDrive.FOLLOW
            for _ in range(_SUBSTEPS):
                rover.step(1 / RATE / _SUBSTEPS)
                self._note_contacts()
        self._lap.metres += length
        self._lap.seconds += clock.at - since

    def _answer(self, call: Call, frame: DriveFrame) -> None:
        answer = self._operator(self._judge, call, frame)
        thing, place = self._lap.calls[-1].about
        due = {str(one) for one in (thing if thing in self._film.surprises else None, place) if one}
        self._lap.due += bool(due - self._asked)
        self._asked |= due
        if self._film.ahead(self._rover.s, NEAR_M) is not None:
            answer = replace(answer, motion=Motion.NONE)
        with suppress(CommandError, AnyTraverseError):
            self._judge.answer(answer, frame.at)
        if answer.motion is Motion.GO:
            self._judge.go_where_uncovered(call.id, frame.at)
        self._waits = 0 if answer.motion is Motion.GO else call.id

    def _help(self, now: float) -> None:
        """Take away what is in the way of a rover that stands. Then say go, or drive it on by hand."""
        holding, ahead = self._judge.holding, self._film.ahead(self._rover.s, NEAR_M)
        if ahead is None and self._waits:
            self._judge.go_where_uncovered(self._waits, now)
            self._waits = 0
        self._by_hand = self._by_hand and holding
        stands = holding and not self._by_hand and self._rover.speed < STANDSTILL
        self._stood_s = self._stood_s + 1 / RATE if stands else 0.0
        if ahead is not None and (self._by_hand or self._stood_s >= TAKEN_S):
            self._film.world.remove(ahead.id)
            self._lap.taken += 1
            self._stood_s = 0.0
        elif self._stood_s >= BY_HAND_S:
            self._by_hand = True
            self._lap.by_hand += 1

    def _note_contacts(self) -> None:
        rover = self._rover
        touched = set(self._film.world.contact(rover.x, rover.y, rover.body.radius))
        self._lap.contacts += sorted(touched - self._touching)
        self._touching = touched


def drive(job: Route) -> dict[str, LapResult]:
    """Drive two laps, "first" and "second"; or film a lap, answer it at the desk, and drive "rehearsed"."""
    config = of_the_field(RATE, SPEED)
    worlds, engine = Worlds(job.kilometres, job.metres), alone(config)
    asked: set[str] = set()
    clock = RouteClock()
    if job.rehearsed:
        memory = rehearsed(DriveJudge(config, engine), worlds, clock, config.journal.scenes)
        engine = AnyTraverse(engine.perceiver, engine.settings, memory)
    judge = DriveJudge(config, engine)
    laps = {name: LapResult() for name in (("rehearsed",) if job.rehearsed else ("first", "second"))}
    for name, lap in laps.items():
        for film in worlds.each():
            RouteRover(film, judge, lap, asked, clock).drive()
            print(f"route, {name}: {len(lap.calls)} calls in {lap.metres:.0f} m", flush=True)
    return laps


def rehearsed(judge: DriveJudge, worlds: Worlds, clock: RouteClock, limit: int) -> Memory:
    """Answer a filmed lap at the desk. Return the memory of a new rover that was given its scenes."""
    begun = judge.engine.memory
    for film in worlds.each():
        asked = operator(OPERATOR, film.operator, DRIVABLE)
        run_trials([Trial(Combination.of(judge.engine.settings), judge, asked)], _filmed(film, clock))
    scenes = [Scene(entry) for entry in judge.engine.memory.history]
    first = first_memory(begun.model_id, begun.preferences, limit)
    return merged(first, scenes, limit, judge.engine.perceiver.meaning)[0]


def _filmed(film: FilmedField, clock: RouteClock) -> Iterator[DriveFrame]:
    """Film a lap that a person drives, who has things out of the way in time."""
    trail, begun = film.world.trail, clock.driven
    step = SPEED / RATE
    for number in range(math.ceil(trail.length / step)):
        s = trail.start + number * step
        near = film.ahead(s, PASSED_M)
        if near is not None:
            film.world.remove(near.id)
        clock.driven = begun + number * step
        yield film.frame(trail.pose(s), clock.next(), clock.driven)


def figures(laps: Mapping[str, LapResult]) -> dict[str, Any]:
    """Return the figures of the laps as JSON values."""
    found: dict[str, Any] = {}
    for name, lap in laps.items():
        per_km = round(1000 * len(lap.calls) / lap.metres, 2)
        found[name] = {
            "calls_per_km": per_km,
            "operator_s_per_km": round(ANSWER_S * per_km, 1),
            "surplus_share": round(1 - lap.due / len(lap.calls), 3) if lap.calls else 0.0,
            "contacts": len(lap.contacts),
            "calls": len(lap.calls),
            "km": round(lap.metres / 1000, 2),
            "taken_away": lap.taken,
            "driven_on_by_hand": lap.by_hand,
            "hours": round(lap.seconds / 3600, 2),
        }
    return found
