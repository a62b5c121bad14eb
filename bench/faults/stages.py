"""Produces faults while a rover drives the simulated trail, on the stages of bench.stopping."""

from __future__ import annotations

import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from random import Random

from bench.faults.row import RowOutcome, Work
from bench.stopping.faults import InjectedFault
from bench.stopping.jobs import LATE, TRIES, Job
from bench.stopping.runs import faults
from bench.stopping.scenes import Seen, StoppingScene
from bench.stopping.stage import Disturbed, Plan, Stage

SCRIPT_WITHIN = 1.5 + 0.5
"""s from the last heartbeat that the script believed to its order: ATS_TIMEOUT and half a second."""

Produce = Callable[[Work], RowOutcome]


def stops(
    named: InjectedFault | Mapping[str, InjectedFault], times: int, *, breakable: bool = False
) -> Produce:
    """Causes each fault so often while a rover drives, with a seed each; in the short form only one, once.

    breakable: the companion has the perceiver that can be broken.
    """
    every = {"": named} if isinstance(named, InjectedFault) else named

    def produce(work: Work) -> RowOutcome:
        own = dict(list(every.items())[:1]) if work.short else every
        seen = []
        for seed in work.seeds(times):
            job = Job(seed, work.folder, threading.Event())
            for run in faults(job, own, job.random(), breakable=breakable):
                wrong = "" if work.short and run.wrong == LATE else run.wrong
                hold, returned = (run.stop.hold, run.stop.returned) if run.stop else (None, None)
                if run.stop and not wrong and returned is None:
                    wrong = "not well again"
                by = run.stop.by if run.stop else ""
                seen.append(
                    Seen(f"{run.kind} {wrong}".strip() if wrong else "", hold, returned, f"held by {by}")
                )
        said = _faults_told(work.folder)
        return outcome(seen, f"says: {', '.join(said)}" if said else "")

    return produce


def repeated(
    times: int, plan: Callable[[Job, Random], Plan], play: Callable[[Stage, Random], Seen]
) -> Produce:
    """Plays a scene so often, each on a new stage with a seed of its own; in the short form once.

    What must follow is awaited in `follows`. A run that is disturbed before that is begun anew.
    """

    def produce(work: Work) -> RowOutcome:
        jobs = (Job(seed, work.folder, threading.Event()) for seed in work.seeds(times))
        return outcome([_played(job, StoppingScene(plan, play)) for job in jobs])

    return produce


def outcome(seen: Sequence[Seen], saw: str = "") -> RowOutcome:
    """Sums up runs; what they saw is counted."""
    counted = Counter(one.saw for one in seen if one.saw)
    told = [text if count == len(seen) == 1 else f"{text} ({count})" for text, count in counted.items()]
    return RowOutcome(
        len(seen),
        tuple(one.wrong for one in seen if one.wrong),
        _most(one.hold_s for one in seen),
        _most(one.return_s for one in seen),
        "; ".join([*told, saw] if saw else told),
    )


def _played(job: Job, scene: StoppingScene, attempt: int = 0) -> Seen:
    try:
        return scene.seen(job, job.random(attempt))
    except Disturbed as why:
        if attempt + 1 == TRIES:
            return Seen(str(why))
    return _played(job, scene, attempt + 1)


def _faults_told(folder: Path) -> list[str]:
    """Returns what the companions' logs call the faults, the most frequent first."""
    logs = [log.read_text(encoding="utf-8", errors="replace") for log in sorted(folder.glob("*/daemon.log"))]
    names = re.findall(r"fault: ([a-z][^:\n]*)", "\n".join(logs))
    return [name.strip() for name, _ in Counter(names).most_common(3)]


def _most(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(max(known), 2) if known else None
