"""Makes the stages of one seed, and says what came of a run on one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random

from bench.stopping.stage import Disturbed, Plan, Stage
from bench.stopping.stops import Stop
from companion.sim.demo.pace import SPEED
from companion.sim.field.trail import Trail

SLOW, FAST = 0.6, SPEED
TRIES = 3
LATE = "too late"
"""The rover stands, but took longer or went farther than its limit."""


@dataclass(frozen=True)
class Run:
    """One run. wrong: what went wrong, "" for nothing, LATE if that is all. stop: if one was due.

    commanded: orders in report policy. disturbed: how often the run was started again because the rover was
    not driving when it should have been. saw: what followed, in a few words, where that may differ.
    """

    kind: str
    seed: int
    wrong: str = ""
    stop: Stop | None = None
    commanded: int = 0
    disturbed: int = 0
    saw: str = ""


@dataclass
class Job:
    """A seed, the folder for its files, and how to cancel.

    brakes: as of `Plan`. speed: m/s where it guides.
    """

    seed: int
    out: Path
    cancelled: threading.Event
    brakes: bool = False
    speed: float = FAST

    def __post_init__(self) -> None:
        self.trail = Trail(self.seed)
        self._stages = 0

    def random(self, *what: object) -> Random:
        """Makes a random generator: the same for the same seed and purpose."""
        return Random(f"{self.seed} {what}")

    def plan(self, random: Random) -> Plan:
        """Makes a plan: a place on the trail, and a speed below the fastest."""
        return Plan(self.seed, random.uniform(0.0, self.trail.length), FAST, brakes=self.brakes)

    def stage(self, plan: Plan, out: Path | None = None) -> Stage:
        """Makes a new stage, in a folder of its own."""
        self._stages += 1
        return Stage(out or self.out / f"{self.seed}-{self._stages}", plan, self.cancelled)


def retried(job: Job, kind: str, run: Callable[[Random], Run], disturbed: int = 0) -> Run:
    """Does a run, and begins it anew where it is disturbed, `TRIES` times in all."""
    try:
        return replace(run(job.random(kind, disturbed)), disturbed=disturbed)
    except Disturbed as why:
        if disturbed + 1 == TRIES:
            return Run(kind, job.seed, str(why), disturbed=TRIES)
    return retried(job, kind, run, disturbed + 1)


def verdict(stop: Stop) -> str:
    """Returns what was wrong with a stop, as in `Run`."""
    return "not stopped" if not stop.stands else "" if stop.stopped else LATE
