"""Drives one lap of the simulated trail a seed, answered at once by each operator: how many calls repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bench.calls.engines import engines, of_the_field
from bench.calls.field import DRIVABLE, FilmedField, lap
from bench.calls.operators import OPERATORS, AnsweredCall, Listed, operator
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.trial import Combination, Trial, run_trials
from companion.sim.field.things import World

RATE, SPEED = 5.0, 2.0
"""Frames/s, and m/s."""


@dataclass(frozen=True)
class Lap:
    """One seed's lap. metres: None for a whole lap. rate: frames/s that are judged."""

    seed: int
    rate: float = RATE
    metres: float | None = None


def drive(job: Lap) -> tuple[float, dict[str, list[AnsweredCall]]]:
    """Drive a lap with each operator. Return its metres, and the calls by operator."""
    config = of_the_field(job.rate, SPEED)
    field = FilmedField(World(job.seed))
    listed = {name: Listed(operator(name, field.operator, DRIVABLE), field.about) for name in OPERATORS}
    own = zip(engines(config, len(listed)), listed.values(), strict=True)
    trials = [Trial(Combination.of(one.settings), DriveJudge(config, one), each) for one, each in own]
    run_trials(trials, lap(field, rate=job.rate, speed=SPEED, metres=job.metres))
    metres = field.world.trail.length if job.metres is None else job.metres
    return metres, {name: each.calls for name, each in listed.items()}


def figures(laps: Sequence[tuple[float, dict[str, list[AnsweredCall]]]]) -> dict[str, Any]:
    """Return the figures of some seeds as JSON values."""
    metres = sum(driven for driven, _ in laps)
    found: dict[str, Any] = {}
    for name in OPERATORS:
        calls = [call for _, by_operator in laps for call in by_operator[name]]
        found[name] = {
            "calls": len(calls),
            "calls_per_100m": round(100 * len(calls) / metres, 2) if metres else None,
            "repeats": sum(call.repeat for call in calls),
        }
    return found
