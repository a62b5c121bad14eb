"""Says what is to be done for each part, does it in any process, and puts the figures together."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.calls import beside, noticed, passing, plot, real, route, trail

PARTS = ("trail", "real", "noticed", "beside", "passing", "route")
SEEDS, UNTUNED, QUICK_SEEDS = tuple(range(8)), tuple(range(8, 16)), (0, 1, 2)
DRIVES: dict[str, Callable[[Any], Any]] = {
    "trail": trail.drive,
    "trail_untuned": trail.drive,
    "real": real.drive,
    "noticed": noticed.drive,
    "beside": beside.drive,
    "passing": passing.drive,
    "route": route.drive,
}
CONDITIONS = {
    "trail": f"320x240, {trail.RATE:g} frames/s, {trail.SPEED:g} m/s, position and metres known",
    "real": f"{real.RATE:g} frames/s whatever lies between them; no position; {real.TRAINED}",
    "route": f"320x240, {route.RATE:g} frames/s, {route.SPEED:g} m/s; answered by {route.OPERATOR}",
    "without_new_word": "of the calls for a scene, the share whose answer brought no word",
}
KM, QUICK_KM = 10, 2
EVERY = 2
"""With --quick every second frame is judged."""


@dataclass(frozen=True)
class PartJob:
    """A piece of work of a part, for one process."""

    part: str
    title: str
    what: Any


@dataclass(frozen=True)
class JobResult:
    """What a job found, and the seconds that it took."""

    job: PartJob
    found: Any
    seconds: float


def work(job: PartJob) -> JobResult:
    """Do a job."""
    began = time.monotonic()
    found = DRIVES[job.part](job.what)
    return JobResult(job, found, round(time.monotonic() - began, 1))


def jobs_of(
    parts: Sequence[str], given_seeds: Sequence[int], data: Path, *, quick: bool
) -> tuple[list[PartJob], dict[str, str]]:
    """Return the jobs, the longest first, and why parts are left out.

    given_seeds: of the trail; empty for `SEEDS` and `UNTUNED`. data: the folder of labelled frames.
    """
    rate = trail.RATE / EVERY if quick else trail.RATE
    seeds = {"trail": given_seeds or (QUICK_SEEDS if quick else SEEDS), "trail_untuned": UNTUNED}
    if given_seeds or quick:
        seeds["trail_untuned"] = ()
    left_out = dict[str, str]()
    jobs = list[PartJob]()
    if "route" in parts:
        for again in (True, False):
            title = "route, after a rehearsal" if again else "route, two laps"
            jobs.append(PartJob("route", title, route.Route(QUICK_KM if quick else KM, rehearsed=again)))
    if not (data / "trail").is_dir():
        needed = [part for part in ("real", "noticed") if part in parts]
        left_out = dict.fromkeys(needed, f"needs the labelled frames trail/ and abroad/ in {data}")
        parts = [part for part in parts if part not in needed]
    if "real" in parts:
        jobs.append(PartJob("real", "real frames", real.Passes(data / "trail", EVERY if quick else 1)))
    if "noticed" in parts:
        states = noticed.states(data, noticed.QUICK_COUNT if quick else noticed.COUNT)
        jobs += [PartJob("noticed", f"noticed, {one.name}", one) for one in states]
    if "beside" in parts:
        of = beside.Beside
        chosen = [of(s, beside.AT_S[:1]) for s in QUICK_SEEDS] if quick else [of(s) for s in SEEDS]
        jobs += [PartJob("beside", f"beside, seed {one.seed}", one) for one in chosen]
    if "passing" in parts:
        runs = passing.approaches(QUICK_SEEDS[:1], passing.WAYS[:2]) if quick else passing.approaches(SEEDS)
        jobs += [
            PartJob("passing", f"passing, seed {one.seed}, {one.speed:g} m/s, {one.way}", one) for one in runs
        ]
    if "trail" in parts:
        for part, each in seeds.items():
            jobs += [PartJob(part, f"trail, seed {seed}", trail.Lap(seed, rate)) for seed in each]
    return jobs, left_out


def told(done: list[JobResult], left_out: dict[str, str]) -> dict[str, Any]:
    """Return the last line."""
    found: dict[str, Any] = {}
    for part in dict.fromkeys(one.job.part for one in done):
        own = [one for one in done if one.job.part == part]
        if part == "real":
            found[part] = real.figures(own[0].found)
            found["foreign_known"] = real.foreign_known(own[0].found)
            driven = own[0].found
            found["series"] = [plot.series(driven.calls, driven.frames, real.RATE, driven.again).as_json()]
        elif part == "noticed":
            found[part] = {one.job.what.name: one.found for one in own}
        elif part == "beside":
            found[part] = beside.figures([trial for one in own for trial in one.found])
        elif part == "passing":
            found[part] = passing.figures([one.job.what for one in own], [one.found for one in own])
        elif part == "route":
            laps = {name: lap for one in reversed(own) for name, lap in one.found.items()}
            found[part] = route.figures(laps)
        else:
            found[part] = trail.figures([one.found for one in own])
    seconds = dict[str, float]()
    for one in done:
        seconds[one.job.part] = round(seconds.get(one.job.part, 0.0) + one.seconds, 1)
    return {**found, "conditions": CONDITIONS, "left_out": left_out, "seconds": seconds}
