"""Puts a second thing beside one that was answered: whether a rover calls or stands for it all the same."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product, starmap
from typing import Any

from anytraverse.engine import AnyTraverse
from bench.calls.engines import alone, of_the_field
from bench.calls.field import DRIVABLE, FilmedField
from bench.calls.operators import operator
from bench.perception.figures import share
from companion.calls.decisions import Call
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.sim.field.things import FieldThing, World
from companion.wire.ids import Motion

RATE, SPEED = 5.0, 1.5
"""Frames/s, and m/s: as the demo drives."""
FROM_M, TO_M = 12.0, 2.0
"""Metres from the first thing at which an approach begins and ends."""
AT_S = (22.0, 36.0)
"""Metres after the begin of the meadow at which the first thing lies."""
ASIDE_M = 0.45
"""Metres from the middle of the path to each of both things, which lie on either side of it."""
SETTLED = 5
"""Frames from the answer to the second thing, at least."""
ANSWERS = ("go", "tap")
SECONDS = ("drum", "rock")
"""What the second thing is."""


@dataclass(frozen=True)
class Beside:
    """Names a world by its seed, and how often a thing is approached in it at each place."""

    seed: int
    places: tuple[float, ...] = AT_S


@dataclass(frozen=True)
class _Trial:
    """One approach. side: of the first thing, 1 for the left. at: metres along the trail."""

    answer: str
    second: str
    side: int
    at: float


def drive(job: Beside) -> list[tuple[_Trial, bool | None]]:
    """Make all approaches, each with the second thing and without it. Return whether that was noticed.

    None where the first thing was not answered in time, or asks again before the second is noticed.
    """
    config = of_the_field(RATE, SPEED)
    film, engine = FilmedField(World(job.seed, ("drum", "rock"))), alone(config)
    things = {thing.kind: thing for thing in film.world.things.values() if thing.surprise}
    for thing in things.values():
        film.world.remove(thing.id)
    found: list[tuple[_Trial, bool | None]] = []
    for trial in starmap(_Trial, product(ANSWERS, SECONDS, (1, -1), job.places)):
        runs = []
        for second in (things[trial.second], None):
            new = AnyTraverse(engine.perceiver, engine.settings, engine.memory)
            runs.append(_Approach(DriveJudge(config, new), film, trial).run(things["drum"], second))
        found.append((trial, outcome(trial.answer, *runs)))
    return found


def outcome(answer: str, both: ApproachRun, alone: ApproachRun) -> bool | None:
    """Return whether the second thing was noticed, from the approach with both and with the first alone."""
    if both.since is None or alone.since is None:
        return None
    if answer != "go":  # the rover stands already: it must be called, or go on standing
        return both.called is not None or both.holds
    if alone.stopped is not None and (both.stopped is None or alone.stopped <= both.stopped):
        return None
    return both.stopped is not None


@dataclass
class ApproachRun:
    """Holds one approach. since: the frame from which the second thing lay there, None: never.

    called, stopped: frame in which a call opened since then, or the rover would have stood anew. holds:
    whether it would stand in the last frame.
    """

    since: int | None = None
    called: int | None = None
    stopped: int | None = None
    holds: bool = False


class _Approach:
    """Drives up to a thing, answers its call, and puts a second one beside it."""

    def __init__(self, judge: DriveJudge, film: FilmedField, trial: _Trial) -> None:
        self._judge, self._film, self._trial = judge, film, trial
        self._operator = operator(trial.answer, film.operator, DRIVABLE)

    def run(self, first: FieldThing, second: FieldThing | None) -> ApproachRun:
        """Drive the whole approach. second: None for one with the first thing alone."""
        run, world, trial = ApproachRun(), self._film.world, self._trial
        answered: int | None = None
        held = False
        world.things["first"] = self._placed(first, "first", trial.side)
        try:
            for number, frame in enumerate(self._frames(trial.at)):
                judged = self._judge.judge(frame)
                assert judged is not None
                run.holds = self._judge.holding
                if run.since is not None:
                    if judged.opened is not None and run.called is None:
                        run.called = number
                    if (judged.opened is not None or (run.holds and not held)) and run.stopped is None:
                        run.stopped = number
                    held = run.holds
                elif answered is not None and number - answered >= SETTLED:
                    if trial.answer == "go" and run.holds:
                        continue  # it does not drive on yet
                    if second is not None:
                        world.things["second"] = self._placed(second, "second", -trial.side)
                    run.since, held = number + 1, run.holds
                if judged.opened is not None and run.since is None:
                    self._answer(judged.opened, frame)
                    answered = number
        finally:
            for name in {"first", "second"} & world.things.keys():
                world.remove(name)
        return run

    def _placed(self, thing: FieldThing, name: str, side: int) -> FieldThing:
        world = self._film.world
        world.revision += 1
        pose = world.trail.pose(self._trial.at)
        x = pose.x - side * ASIDE_M * math.sin(pose.heading)
        return replace(thing, id=name, x=x, y=pose.y + side * ASIDE_M * math.cos(pose.heading))

    def _frames(self, at: float) -> Iterator[DriveFrame]:
        step = SPEED / RATE
        for number in range(math.floor((FROM_M - TO_M) / step)):
            s = at - FROM_M + number * step
            yield self._film.frame(self._film.world.trail.pose(s), (number + 1) / RATE, number * step)

    def _answer(self, call: Call, frame: DriveFrame) -> None:
        """Answer a call. What a tap of no positive weight does not cover stays as it is."""
        answer = self._operator(self._judge, call, frame)
        self._judge.answer(answer, frame.at)
        if answer.motion is Motion.GO:
            self._judge.go_where_uncovered(call.id, frame.at)


def figures(found: Sequence[tuple[_Trial, bool | None]]) -> dict[str, Any]:
    """Return the figures as JSON values. void: approaches that say nothing."""
    counted = [(trial, hit) for trial, hit in found if hit is not None]
    hits = [hit for _, hit in counted]
    parts = {
        f"after_{answer}": sum(hit for trial, hit in counted if trial.answer == answer) for answer in ANSWERS
    }
    return {
        "noticed": sum(hits),
        "of": len(hits),
        **parts,
        **{f"of_{answer}": sum(trial.answer == answer for trial, _ in counted) for answer in ANSWERS},
        "ci95": share(hits).as_json()["ci95"],
        "void": len(found) - len(counted),
    }
